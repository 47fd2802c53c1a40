//! The thread that is the device: the world's clock, the board's interrupt and main loop, and the line.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::sync::mpsc::{Receiver, Sender, TryRecvError};
use std::time::{Duration, Instant};

use embedded_hal::delay::DelayNs;
use embedded_hal::spi::{ErrorType, Operation, SpiDevice};
use palpate_firmware_core::ads131m::Ads131m;
use palpate_firmware_core::device::Order;
use palpate_firmware_core::sampler::IDLE_US;
use palpate_firmware_core::store::{MatrixStore, MemoryFlash};
use palpate_firmware_core::{
    ConverterClock, Device, DeviceSettings, Identity, Queues, Sampler, SelectSource, SourceNotPossible,
};
use palpate_shared::sim::{
    CarriedBeam, Channels, Faults, FloatingBus, Load, PortBusy, Script, SimulatedFrontEnd, SpiPort,
};
use palpate_shared::units::DeviceTime;
use palpate_shared::wire::{Axis, Bridge, Channel, ClockSource, DeviceId, FrontEndKind, RestartReason, Source};

use super::outlet::Outlet;
use super::robot::SimulatedRobot;
use super::troubled_outlet::TroubledOutlet;
use super::{CarriedCourse, Config, InjectedOnLink, LinkFaults, Pace, SimulatedMoment};

/// How often a device in real time wakes: half a block, so that samples are at most this late.
const TICK: Duration = Duration::from_millis(1);

/// Most conversions in one tick. A computer that is busy elsewhere may make the world late; catching up at some eight
/// times the default rate, and not all at once, gives the host time to read: no line has to swallow seconds of samples.
const CATCH_UP: u32 = 32;

/// How long the world waits for a host whose line is full. A pseudo-terminal holds 12 KiB, a third of a second; a USB
/// driver five times that. On a computer that is busy elsewhere the host gets its turn within this time, and is not
/// blamed for it; one that does not read for longer loses samples as it would on a board.
const HOST_PATIENCE: Duration = Duration::from_secs(2);

/// How long a device that has nothing to do, or whose host does not read, rests.
const REST: Duration = Duration::from_micros(200);

/// The same for one that is carried, whose host asks for each block.
const REST_CARRIED: Duration = Duration::from_micros(20);

/// Conversions that a device at its host's pace makes between two looks at its line: one block.
const STRIDE: u64 = 8;

/// Strides that a device makes each time it is asked to go on: an eighth of a second at 4 kHz.
const ASKED_STRIDES: u32 = 64;

/// How often the sampler looks after its front-end whether or not data come, in µs of device time: as on the board,
/// whose tick does not wait for the converter either.
const LOOK_EVERY_US: u32 = IDLE_US;

/// Conversions before a board listens to its line.
const START_UP: u32 = 8;

/// How long an order waits for the line to take what is due, in µs of device time: as on the board. A line that is always
/// behind would let it wait for ever.
const ORDER_US: u32 = 100_000;

/// Time between two temperatures, in µs of device time.
const TEMPERATURE_EVERY_US: u32 = 1_000_000;

/// Bits that a byte takes on a serial line, start and stop bit included.
const BITS_PER_BYTE: f64 = 10.0;

/// Bytes that the firmware keeps for a line that is busy: 60 blocks, 0.1 s at 4 kHz, as on the board.
const OUTBOX_BYTES: usize = 4096;

/// Words in a sector of the simulated flash: room for 512 changes of the matrix, as on the board.
const FLASH_WORDS: usize = 4096;

/// How long a board stands still when it writes a record of eight words without erasing, in µs: 16 µs each.
const STORE_US: u32 = 8 * 16;

/// Volts to millivolts, to state the finger's excitation in the hello.
const MV_PER_V: f32 = 1e3;

/// An order from the device's owner; each is answered with the moment from which it holds.
#[derive(Debug)]
pub(super) enum Control {
    Load(Load, Sender<SimulatedMoment>),
    Script(Box<Script>, Sender<SimulatedMoment>),
    Course(CarriedCourse, Sender<SimulatedMoment>),
    Faults(Faults, Sender<SimulatedMoment>),
    Inputs(u8, Sender<SimulatedMoment>),
    /// From a time on, on the world's clock, in ns.
    InputsAt(u64, u8, Sender<SimulatedMoment>),
    LinkFaults(LinkFaults, Sender<SimulatedMoment>),
    Injected(Sender<InjectedOnLink>),
    Now(Sender<SimulatedMoment>),
    LetTimePass(Sender<SimulatedMoment>),
    Unplug(Sender<SimulatedMoment>),
    PlugIn(Sender<SimulatedMoment>),
    Restart(Sender<SimulatedMoment>),
    Disturb(Vec<u8>, Sender<SimulatedMoment>),
    End,
}

/// Why a device stopped running.
enum Ended {
    /// By chance, or ordered by somebody who waits.
    Restart(Option<Sender<SimulatedMoment>>),
    ForGood,
}

/// Runs the device until its owner is gone, over as many restarts as are ordered. The world goes on over a restart:
/// what presses presses, what is broken stays broken.
pub(super) fn run(config: &Config, outlet: Outlet, orders: &Receiver<Control>, epoch: Instant) {
    match config.finger.channels {
        Channels::Two => run_with::<2>(config, outlet, orders, epoch),
        Channels::Four => run_with::<4>(config, outlet, orders, epoch),
    }
}

/// The same on a converter of so many channels.
fn run_with<const CHANNELS: usize>(config: &Config, outlet: Outlet, orders: &Receiver<Control>, epoch: Instant) {
    let front_end = RefCell::new(SimulatedFrontEnd::new(config.finger, config.seed));
    front_end.borrow_mut().set_faults(config.faults);
    let mut finger = CarriedBeam::new(config.finger.beam, config.carried);
    let mut outlet = TroubledOutlet::new(outlet, config.link_faults, config.seed);
    let mut inputs_due = BTreeMap::new();
    let mut store = MatrixStore::new(MemoryFlash::default());
    let mut restarts = 0;
    let mut asked: Option<Sender<SimulatedMoment>> = None;
    loop {
        let mut queues = Queues::new();
        let (sampler_end, device_end) = queues.split();
        let settings = DeviceSettings::at_start(config.baud.unwrap_or(0), ConverterClock::NOMINAL);
        let mut board = Board {
            started_ns: front_end.borrow().truth().time_ns,
            front_end: &front_end,
            finger: &mut finger,
            inputs_due: &mut inputs_due,
            sampler: Sampler::new(Ads131m::<_, CHANNELS>::new(SimulatedOnly::new(&front_end)), sampler_end, settings),
            device: Device::new(identity(config, restarts), device_end),
            conversions: 0,
            looked_at: DeviceTime(0),
            temperature_at: DeviceTime(0),
            course: None,
            robot: config.carried_by.clone(),
            asked: None,
            order: None,
            is_in_loader: false,
            store: &mut store,
        };
        board.device.accept_restarts();
        board.device.accept_store(board.store.kept());
        if let Some(asked) = asked.take() {
            answer(&asked, board.moment());
        }
        match board.live(config, &mut outlet, orders, epoch) {
            Ended::ForGood => return,
            Ended::Restart(sender) => asked = sender,
        }
        power_cycle(&mut front_end.borrow_mut());
        restarts = u16::saturating_add(restarts, 1);
    }
}

/// Takes the supply from the chip and gives it back: it forgets its settings.
fn power_cycle(front_end: &mut SimulatedFrontEnd) {
    let faults = front_end.faults();
    front_end.set_faults(Faults { chip_absent: Some(FloatingBus::Low), ..faults });
    front_end.set_faults(faults);
}

/// What the simulated board says of itself.
fn identity(config: &Config, restarts: u16) -> Identity {
    let mut device = *b"sim-........";
    device[4..].copy_from_slice(&config.seed.to_be_bytes());
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few thousand millivolts")]
    let excitation_mv = (config.finger.bridges.excitation_v * MV_PER_V) as u16;
    Identity {
        device: DeviceId(device),
        board: "simulated",
        clock: ClockSource::Host,
        link_baud: config.baud.unwrap_or(0),
        restart: if restarts == 0 { RestartReason::PowerOn } else { RestartReason::Requested },
        restarts,
        front_end: match config.finger.channels {
            Channels::Two => FrontEndKind::Ads131m02,
            Channels::Four => FrontEndKind::Ads131m04,
        },
        converter_clock: ConverterClock::NOMINAL,
        excitation_mv,
        channels: [Axis::X, Axis::Y].map(|axis| Channel { axis, bridge: Bridge::Half }),
        source: Source::Simulated,
    }
}

/// A bus with nothing but the simulation behind it, which therefore never passes for hardware.
#[derive(Clone, Copy, Debug)]
pub struct SimulatedOnly<'w>(SpiPort<'w>);

impl<'w> SimulatedOnly<'w> {
    /// The bus of a simulated front-end.
    #[must_use]
    pub const fn new(front_end: &'w RefCell<SimulatedFrontEnd>) -> Self {
        Self(SpiPort::new(front_end))
    }
}

impl ErrorType for SimulatedOnly<'_> {
    type Error = PortBusy;
}

impl SpiDevice for SimulatedOnly<'_> {
    fn transaction(&mut self, operations: &mut [Operation<'_, u8>]) -> Result<(), PortBusy> {
        self.0.transaction(operations)
    }
}

impl DelayNs for SimulatedOnly<'_> {
    fn delay_ns(&mut self, duration_ns: u32) {
        self.0.delay_ns(duration_ns);
    }
}

impl SelectSource for SimulatedOnly<'_> {
    fn select(&mut self, source: Source) -> Result<(), SourceNotPossible> {
        match source {
            Source::Simulated => Ok(()),
            Source::Hardware => Err(SourceNotPossible),
        }
    }

    fn is_simulated(&self) -> bool {
        true
    }

    fn inputs(&self) -> u8 {
        self.0.inputs()
    }
}

/// A board: the firmware, and the world that its front-end stands in.
struct Board<'w, const CHANNELS: usize> {
    /// World time at which it started.
    started_ns: u64,
    front_end: &'w RefCell<SimulatedFrontEnd>,
    /// Beam and disk, which go on swinging over a restart.
    finger: &'w mut CarriedBeam,
    sampler: Sampler<'w, Ads131m<SimulatedOnly<'w>, CHANNELS>>,
    device: Device<'w, OUTBOX_BYTES>,
    conversions: u64,
    /// Device time at which the sampler last looked after its front-end.
    looked_at: DeviceTime,
    /// Device time of the last temperature sent.
    temperature_at: DeviceTime,
    /// What the inputs change to, by the world's time in ns; over restarts too, of which light barriers know nothing.
    inputs_due: &'w mut BTreeMap<u64, u8>,
    /// What happens to the finger, and the world's time at which that began, in ns.
    course: Option<(CarriedCourse, u64)>,
    /// Who carries the finger while no course does.
    robot: Option<SimulatedRobot>,
    /// Strides that a session has still asked for, and where to say that they are done.
    asked: Option<(u32, Sender<SimulatedMoment>)>,
    /// What the host ordered, and when that was.
    order: Option<(Order, DeviceTime)>,
    /// The chip's own loader has taken over: the line is dead until the next restart.
    is_in_loader: bool,
    /// What outlives a restart.
    store: &'w mut MatrixStore<MemoryFlash<FLASH_WORDS>>,
}

impl<const CHANNELS: usize> Board<'_, CHANNELS> {
    /// Lives until ordered otherwise.
    fn live(
        &mut self,
        config: &Config,
        outlet: &mut TroubledOutlet,
        orders: &Receiver<Control>,
        epoch: Instant,
    ) -> Ended {
        let mut line = LineSpeed { baud: config.baud, allowance: 0.0, paid_us: 0 };
        let mut busy_since = None;
        // A board looks for its front-end before it listens to its line.
        (0..START_UP).for_each(|_| self.convert());
        loop {
            loop {
                match orders.try_recv() {
                    Ok(order) => {
                        if let Some(ended) = self.carry_out(order, outlet) {
                            return ended;
                        }
                    }
                    Err(TryRecvError::Disconnected) => return Ended::ForGood,
                    Err(TryRecvError::Empty) => break,
                }
            }
            if outlet.meet_chance(self.world_us()) {
                return Ended::Restart(None);
            }
            let heard = self.listen(outlet);
            match self.due_order() {
                Some(Order::Reboot) => return Ended::Restart(None),
                Some(Order::EnterLoader) => self.is_in_loader = true,
                // It takes no other.
                Some(Order::Fail(_)) | None => {}
            }
            match config.pace {
                Pace::RealTime => {
                    match self.talk(outlet, &mut line) {
                        Talk::HostBusy => _ = busy_since.get_or_insert_with(Instant::now),
                        Talk::AllSent | Talk::LineBusy => busy_since = None,
                    }
                    if busy_since.is_none_or(|since| since.elapsed() > HOST_PATIENCE) {
                        self.catch_up(epoch, outlet, &mut line);
                    }
                    std::thread::sleep(TICK);
                }
                Pace::AsRead => {
                    let talk = self.talk(outlet, &mut line);
                    if talk != Talk::HostBusy {
                        (0..STRIDE).for_each(|_| self.convert());
                    }
                    let idle = !heard && self.device.transmit().is_empty();
                    if talk == Talk::HostBusy || idle {
                        std::thread::sleep(REST);
                    }
                }
                Pace::AsAsked => {
                    let talk = self.talk(outlet, &mut line);
                    // Whoever asks is not kept waiting; bytes of a host that only writes are.
                    if (talk == Talk::HostBusy || !self.go_on_as_asked())
                        && let Ok(order) = orders.recv_timeout(if self.robot.is_some() { REST_CARRIED } else { REST })
                        && let Some(ended) = self.carry_out(order, outlet)
                    {
                        return ended;
                    }
                }
            }
        }
    }

    /// Carries out an order; how the board's run ends, if it does.
    fn carry_out(&mut self, order: Control, outlet: &mut TroubledOutlet) -> Option<Ended> {
        match order {
            Control::Restart(sender) => Some(Ended::Restart(Some(sender))),
            Control::End => Some(Ended::ForGood),
            order => {
                self.obey(order, outlet);
                None
            }
        }
    }

    fn obey(&mut self, order: Control, outlet: &mut TroubledOutlet) {
        if matches!(order, Control::Load(..) | Control::Script(..)) {
            self.course = None;
        }
        let now_us = self.world_us();
        let mut front_end = self.front_end.borrow_mut();
        let sender = match order {
            Control::Load(load, sender) => {
                front_end.set_load(load);
                sender
            }
            Control::Script(script, sender) => {
                front_end.set_script(*script);
                sender
            }
            Control::Course(course, sender) => {
                front_end.set_load(Load::Released);
                let levels = course.levels(front_end.inputs(), true);
                front_end.set_inputs(levels);
                self.course = Some((course, front_end.truth().time_ns));
                sender
            }
            Control::Faults(faults, sender) => {
                front_end.set_faults(faults);
                sender
            }
            Control::Inputs(levels, sender) => {
                front_end.set_inputs(levels);
                sender
            }
            Control::InputsAt(time_ns, levels, sender) => {
                self.inputs_due.insert(time_ns, levels);
                sender
            }
            Control::LinkFaults(faults, sender) => {
                outlet.set_faults(faults, now_us);
                sender
            }
            Control::Injected(sender) => {
                // As in `answer`.
                let _ = sender.send(outlet.injected());
                return;
            }
            Control::Unplug(sender) => {
                outlet.unplug();
                sender
            }
            Control::PlugIn(sender) => {
                // Without a new terminal the cable stays out, which the host will notice.
                if let Err(error) = outlet.plug_in() {
                    tracing::warn!("the simulated cable stays unplugged: {error}");
                }
                sender
            }
            Control::Disturb(noise, sender) => {
                outlet.disturb(&noise);
                sender
            }
            Control::LetTimePass(sender) => {
                // A robot is to hear of each block before the next.
                self.asked = Some((if self.robot.is_some() { 1 } else { ASKED_STRIDES }, sender));
                return;
            }
            Control::Now(sender) | Control::Restart(sender) => sender,
            Control::End => return,
        };
        drop(front_end);
        answer(&sender, self.moment());
    }

    fn moment(&self) -> SimulatedMoment {
        let truth = self.front_end.borrow().truth();
        SimulatedMoment { conversion: self.conversions, truth, tip_finger: self.finger.tip() }
    }

    /// Hands the firmware what the host sent; whether there was anything.
    fn listen(&mut self, outlet: &mut TroubledOutlet) -> bool {
        let mut buffer = [0; 256];
        let length = outlet.read(&mut buffer, self.world_us());
        if self.is_in_loader {
            return length > 0;
        }
        let now = self.now();
        self.device.receive(&buffer[..length], now);
        if let Some(matrix) = self.device.take_store() {
            let kept = self.store.keep(matrix);
            self.device.stored(kept.map(|()| STORE_US));
        }
        self.device.poll(now);
        length > 0
    }

    /// What the host ordered, once its answer has gone out.
    fn due_order(&mut self) -> Option<Order> {
        let now = self.now();
        if let Some(order) = self.device.take_order() {
            self.order = Some((order, now));
        }
        let (order, ordered) = self.order?;
        if !self.device.transmit().is_empty() && now.since(ordered) < ORDER_US {
            return None;
        }
        self.order = None;
        Some(order)
    }

    /// Takes the samples that a board would have taken by now, up to [`CATCH_UP`] at a time.
    fn catch_up(&mut self, epoch: Instant, outlet: &mut TroubledOutlet, line: &mut LineSpeed) {
        let due_ns = epoch.elapsed().as_nanos();
        for _ in 0..CATCH_UP {
            if u128::from(self.front_end.borrow().truth().time_ns) >= due_ns {
                break;
            }
            self.convert();
            self.talk(outlet, line);
        }
        self.talk(outlet, line);
    }

    /// Makes the next stride that was asked for, or says that all are made; whether there was any.
    fn go_on_as_asked(&mut self) -> bool {
        match self.asked.take() {
            None => return false,
            Some((0, sender)) => answer(&sender, self.moment()),
            Some((left, sender)) => {
                // A robot is to hear of a block as soon as it is whole.
                let mut made = 0;
                while made < STRIDE && (self.robot.is_none() || self.device.transmit().is_empty()) {
                    self.convert();
                    made += 1;
                }
                self.asked = Some((left - 1, sender));
            }
        }
        true
    }

    /// Lets one conversion happen: the world moves, the interrupt comes, the main loop runs.
    fn convert(&mut self) {
        self.conversions += 1;
        let data_ready = self.follow_course();
        self.set_due_inputs();
        if self.is_in_loader {
            return;
        }
        let now = self.now();
        if data_ready {
            self.sampler.data_ready(now);
        }
        // A chip that was given up on is looked for here, and here alone, although its data may come again.
        if !data_ready || now.since(self.looked_at) >= LOOK_EVERY_US {
            self.looked_at = now;
            self.sampler.idle(now);
        }
        self.device.poll(now);
        if now.since(self.temperature_at) >= TEMPERATURE_EVERY_US {
            self.temperature_at = now;
            self.tell_temperature(now);
        }
    }

    /// Lets the world go on by a conversion, with what a course has happen; whether data are ready.
    fn follow_course(&mut self) -> bool {
        let mut front_end = self.front_end.borrow_mut();
        let Some((course, began_ns)) = &self.course else {
            let robot = self.robot.as_ref();
            let acts = |now_ns: u64| robot.map(|robot| robot.go_on_to(now_ns as f64 * 1e-9)).unwrap_or_default();
            return front_end.step_carried(self.finger, acts);
        };
        let at = |now_ns: u64| course.at((now_ns - began_ns) as f64 * 1e-9);
        let data_ready = front_end.step_carried(self.finger, |now_ns| at(now_ns).unwrap_or_default());
        if at(front_end.truth().time_ns).is_none() {
            let levels = course.levels(front_end.inputs(), false);
            front_end.set_inputs(levels);
            self.course = None;
        }
        data_ready
    }

    /// Sets the inputs as they are due by now.
    fn set_due_inputs(&mut self) {
        let mut front_end = self.front_end.borrow_mut();
        while let Some(due) = self.inputs_due.first_entry()
            && *due.key() <= front_end.truth().time_ns
        {
            front_end.set_inputs(due.remove());
        }
    }

    /// What the board's temperature sensor does once a second.
    fn tell_temperature(&mut self, now: DeviceTime) {
        let celsius = self.front_end.borrow().truth().temperature_c;
        #[expect(clippy::cast_possible_truncation, reason = "saturates beyond ±327 °C")]
        self.device.temperature((celsius * 100.0).round() as i16, now);
    }

    /// Puts on the line what it takes.
    fn talk(&mut self, outlet: &mut TroubledOutlet, line: &mut LineSpeed) -> Talk {
        line.earn(self.now());
        let now_us = self.world_us();
        outlet.pass_on(now_us);
        loop {
            let waiting = self.device.transmit();
            let allowed = &waiting[..waiting.len().min(line.allowed())];
            if waiting.is_empty() {
                return Talk::AllSent;
            }
            if allowed.is_empty() {
                return Talk::LineBusy;
            }
            let sent = outlet.write(allowed, now_us);
            if sent == 0 {
                return Talk::HostBusy;
            }
            line.spend(sent);
            self.device.transmitted(sent);
        }
    }

    /// The world's time, which goes on over restarts, in µs.
    fn world_us(&self) -> u64 {
        self.front_end.borrow().truth().time_ns / 1000
    }

    /// The device's clock, which counts conversions from its start.
    fn now(&self) -> DeviceTime {
        #[expect(clippy::cast_possible_truncation, reason = "the device's clock wraps")]
        DeviceTime(((self.front_end.borrow().truth().time_ns - self.started_ns) / 1000) as u32)
    }
}

/// How far the line took what the firmware had to send.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Talk {
    AllSent,
    /// A line of limited speed carries no more yet: the device's time must pass.
    LineBusy,
    /// The host has not read what was sent before.
    HostBusy,
}

/// Tells the owner from when its order holds.
fn answer(sender: &Sender<SimulatedMoment>, moment: SimulatedMoment) {
    // An owner that does not wait for the answer does not need it.
    let _ = sender.send(moment);
}

/// What a line of limited speed can carry by now.
struct LineSpeed {
    baud: Option<u32>,
    /// Bytes that may go out.
    allowance: f64,
    /// Device time up to which the allowance was given.
    paid_us: u32,
}

impl LineSpeed {
    fn earn(&mut self, now: DeviceTime) {
        if let Some(baud) = self.baud {
            let elapsed_s = f64::from(now.since(DeviceTime(self.paid_us))) * 1e-6;
            // An idle line saves nothing up but the bytes that a transmitter holds ready.
            self.allowance = (self.allowance + elapsed_s * f64::from(baud) / BITS_PER_BYTE).min(64.0);
            self.paid_us = now.0;
        }
    }

    fn allowed(&self) -> usize {
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a small number, cut to whole bytes"
        )]
        self.baud.map_or(usize::MAX, |_| self.allowance.max(0.0) as usize)
    }

    fn spend(&mut self, bytes: usize) {
        self.allowance -= bytes as f64;
    }
}
