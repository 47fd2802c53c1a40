//! An outlet with a faulty line behind it, whose cable is pulled and whose device is switched off and on now and then.

use palpate::math::random::Draw;

use super::line_faults::{FaultyLine, LineFaults, microseconds};
use super::outlet::Outlet;
use super::{InjectedOnLink, LinkFaults};

/// Bytes that a faulty line holds before its device finds no room: what a USB serial driver buffers.
const UNDER_WAY_MAX: usize = 65_536;

/// How long a cable that is pulled by chance stays out, in s.
const OUT_S: [f64; 2] = [0.05, 0.5];

/// The device's end of its line, with all that can go wrong on it.
#[derive(Debug)]
pub(super) struct TroubledOutlet {
    outlet: Outlet,
    faults: LinkFaults,
    to_host: FaultyLine,
    to_device: FaultyLine,
    draw: Draw,
    /// When the cable is pulled or plugged in again by chance, in µs of the world's time.
    cable_at_us: Option<u64>,
    is_out: bool,
    /// When the device restarts by chance.
    restart_at_us: Option<u64>,
    unplugged: u64,
    restarted: u64,
}

impl TroubledOutlet {
    pub(super) fn new(outlet: Outlet, faults: LinkFaults, seed: u64) -> Self {
        let line = |way: u64| FaultyLine::new(LineFaults::default(), seed.wrapping_mul(2).wrapping_add(way));
        let mut troubled = Self {
            outlet,
            faults: LinkFaults::default(),
            to_host: line(0),
            to_device: line(1),
            draw: Draw::case(seed, 1),
            cable_at_us: None,
            is_out: false,
            restart_at_us: None,
            unplugged: 0,
            restarted: 0,
        };
        troubled.set_faults(faults, 0);
        troubled
    }

    /// What is wrong from now on.
    pub(super) fn set_faults(&mut self, faults: LinkFaults, now_us: u64) {
        self.faults = faults;
        self.to_host.set_faults(faults.line);
        self.to_device.set_faults(faults.line);
        // A cable that is out by chance comes back all the same.
        if !self.is_out {
            self.cable_at_us = self.some_time(faults.unplug_every_s, now_us);
        }
        self.restart_at_us = self.some_time(faults.restart_every_s, now_us);
    }

    /// What was done so far.
    pub(super) fn injected(&self) -> InjectedOnLink {
        InjectedOnLink {
            to_host: self.to_host.injected(),
            to_device: self.to_device.injected(),
            unplugged: self.unplugged,
            restarted: self.restarted,
        }
    }

    /// Pulls the cable or plugs it in where that is due; whether the device is to restart.
    pub(super) fn meet_chance(&mut self, now_us: u64) -> bool {
        if self.cable_at_us.is_some_and(|at_us| at_us <= now_us) {
            if self.is_out {
                // Without a new terminal the cable stays out, which the host will notice.
                if let Err(error) = self.plug_in() {
                    tracing::warn!("the simulated cable stays unplugged: {error}");
                }
                self.cable_at_us = self.some_time(self.faults.unplug_every_s, now_us);
            } else {
                self.unplug();
                (self.is_out, self.unplugged) = (true, self.unplugged + 1);
                let [shortest, longest] = OUT_S;
                self.cable_at_us = Some(now_us + microseconds(self.draw.uniform(shortest, longest)));
            }
        }
        let restarts = self.restart_at_us.is_some_and(|at_us| at_us <= now_us);
        if restarts {
            self.restarted += 1;
            self.restart_at_us = self.some_time(self.faults.restart_every_s, now_us);
        }
        restarts
    }

    /// A moment from now on that comes once in `every_s` on average, at any time alike; `None` for 0.
    fn some_time(&mut self, every_s: f64, now_us: u64) -> Option<u64> {
        // 1 − unit is never 0, so its logarithm is finite.
        (every_s > 0.0).then(|| now_us + microseconds(-every_s * (1.0 - self.draw.unit()).ln()))
    }

    pub(super) fn unplug(&mut self) {
        self.to_host.cut();
        self.to_device.cut();
        self.outlet.unplug();
    }

    pub(super) fn plug_in(&mut self) -> std::io::Result<()> {
        self.is_out = false;
        self.outlet.plug_in()
    }

    /// Puts bytes on the line towards the host, past all faults.
    pub(super) fn disturb(&mut self, noise: &[u8]) {
        let _ = self.outlet.write(noise);
    }

    /// Reads what the host sent and has arrived; 0 if nothing.
    pub(super) fn read(&mut self, buffer: &mut [u8], now_us: u64) -> usize {
        let length = self.outlet.read(buffer);
        if !self.is_troubled(&self.to_device) {
            return length;
        }
        self.to_device.send(&buffer[..length], now_us);
        let arrived = self.to_device.receive(now_us);
        let (now, later) = arrived.split_at(arrived.len().min(buffer.len()));
        buffer[..now.len()].copy_from_slice(now);
        self.to_device.give_back(later);
        now.len()
    }

    /// Sends as much of `bytes` as the line takes now.
    pub(super) fn write(&mut self, bytes: &[u8], now_us: u64) -> usize {
        if !self.is_troubled(&self.to_host) {
            return self.outlet.write(bytes);
        }
        let taken = bytes.len().min(UNDER_WAY_MAX.saturating_sub(self.to_host.len()));
        self.to_host.send(&bytes[..taken], now_us);
        self.pass_on(now_us);
        taken
    }

    /// Hands the host what has arrived at its end by now.
    pub(super) fn pass_on(&mut self, now_us: u64) {
        if self.is_troubled(&self.to_host) {
            let arrived = self.to_host.receive(now_us);
            let taken = self.outlet.write(&arrived);
            self.to_host.give_back(&arrived[taken..]);
        }
    }

    /// Whether bytes must go through a faulty line: it has faults, or still holds what came while it had.
    fn is_troubled(&self, line: &FaultyLine) -> bool {
        line.faults() != LineFaults::default() || !line.is_idle()
    }
}
