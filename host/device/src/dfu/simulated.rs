//! A loader in memory, as AN3156 describes it: it refuses what comes out of turn, and flash that is not erased cannot be
//! written. For tests, and to try a command without a board.

use std::time::Duration;

use super::{DfuPort, FLASH_BYTES, FLASH_START, SECTORS_KIB};

/// What goes wrong.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Faults {
    /// The write at this address fails.
    pub write_fails_at: Option<u32>,
    /// This byte of the flash does not take a 0.
    pub stuck_at: Option<u32>,
    /// It never gets ready.
    pub hangs: bool,
    /// It is unplugged after so many requests.
    pub unplugged_after: Option<u32>,
}

/// Its states, by their numbers.
const IDLE: u8 = 2;
const DOWNLOAD_SYNC: u8 = 3;
const DOWNLOAD_BUSY: u8 = 4;
const DOWNLOAD_IDLE: u8 = 5;
const MANIFEST: u8 = 7;
const UPLOAD_IDLE: u8 = 9;
const ERROR: u8 = 10;

/// A request that the loader does not take, or that nobody answers any more.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("stalled")]
pub struct Stalled;

/// What a download asked for.
#[derive(Clone, Debug)]
enum Work {
    SetAddress(u32),
    Erase(u32),
    Write(u32, Vec<u8>),
    Leave,
}

/// The loader and its chip.
#[derive(Clone, Debug)]
pub struct Loader {
    /// What the flash holds, from its beginning.
    pub flash: Vec<u8>,
    /// Where the sectors begin that were erased, in order.
    pub erased: Vec<u32>,
    /// Whether it started what it wrote.
    pub has_left: bool,
    /// How long it was waited for, in its own time.
    pub waited: Duration,
    /// How it names its memory.
    pub memory: String,
    faults: Faults,
    state: u8,
    error: u8,
    address: u32,
    work: Option<Work>,
    requests: u32,
}

impl Loader {
    /// A chip whose flash holds something else, and whose loader is in this state.
    #[must_use]
    pub fn new(state: u8, faults: Faults) -> Self {
        Self {
            flash: vec![0x5A; FLASH_BYTES as usize],
            erased: Vec::new(),
            has_left: false,
            waited: Duration::ZERO,
            memory: "@Internal Flash  /0x08000000/04*016Kg,01*064Kg,07*128Kg".to_owned(),
            faults,
            state,
            error: 0,
            address: FLASH_START,
            work: None,
            requests: 0,
        }
    }

    fn count(&mut self) -> Result<(), Stalled> {
        self.requests += 1;
        let gone = self.has_left || self.faults.unplugged_after.is_some_and(|most| self.requests > most);
        if gone { Err(Stalled) } else { Ok(()) }
    }

    fn stall(&mut self) -> Result<(), Stalled> {
        (self.state, self.error) = (ERROR, 15);
        Err(Stalled)
    }

    /// Does what was asked for; an error's number if it cannot.
    fn do_work(&mut self, work: Work) -> Result<(), u8> {
        let place = |address: u32| address.checked_sub(FLASH_START).filter(|at| *at < FLASH_BYTES).ok_or(8_u8);
        match work {
            Work::SetAddress(address) => {
                place(address)?;
                self.address = address;
            }
            Work::Erase(address) => {
                let at = place(address)?;
                let (mut begin, mut kibs) = (0, SECTORS_KIB.iter());
                let size = loop {
                    let size = kibs.next().ok_or(8_u8)? * 1024;
                    if at < begin + size {
                        break size;
                    }
                    begin += size;
                };
                self.flash[begin as usize..(begin + size) as usize].fill(0xFF);
                self.erased.push(FLASH_START + begin);
            }
            Work::Write(address, data) => {
                if self.faults.write_fails_at == Some(address) {
                    return Err(6);
                }
                for (at, byte) in (place(address)?..).zip(data) {
                    let cell = self.flash.get_mut(at as usize).ok_or(8_u8)?;
                    // Flash is written from ones to zeros only.
                    *cell &= byte;
                    if self.faults.stuck_at == Some(FLASH_START + at) {
                        *cell = 0xFF;
                    }
                }
            }
            Work::Leave => self.has_left = true,
        }
        Ok(())
    }
}

impl DfuPort for Loader {
    type Error = Stalled;

    fn memory(&mut self) -> Result<String, Stalled> {
        Ok(self.memory.clone())
    }

    fn download(&mut self, block: u16, data: &[u8]) -> Result<(), Stalled> {
        self.count()?;
        if ![IDLE, DOWNLOAD_IDLE].contains(&self.state) || data.len() > 2048 {
            return self.stall();
        }
        self.work = Some(match (block, data) {
            (_, []) => Work::Leave,
            (0, &[0x21, a, b, c, d]) => Work::SetAddress(u32::from_le_bytes([a, b, c, d])),
            (0, &[0x41, a, b, c, d]) => Work::Erase(u32::from_le_bytes([a, b, c, d])),
            (2.., data) => Work::Write(self.address + u32::from(block - 2) * 2048, data.to_vec()),
            _ => return self.stall(),
        });
        self.state = DOWNLOAD_SYNC;
        Ok(())
    }

    fn upload(&mut self, block: u16, into: &mut [u8]) -> Result<usize, Stalled> {
        self.count()?;
        if ![IDLE, UPLOAD_IDLE].contains(&self.state) || block < 2 {
            self.stall()?;
        }
        self.state = UPLOAD_IDLE;
        let at = (self.address - FLASH_START) as usize + usize::from(block - 2) * 2048;
        let there = self.flash.get(at..).unwrap_or_default();
        let length = there.len().min(into.len());
        into[..length].copy_from_slice(&there[..length]);
        Ok(length)
    }

    /// The first look sets it to work, as AN3156 says; the next finds it done.
    fn status(&mut self) -> Result<[u8; 6], Stalled> {
        self.count()?;
        let mut wait_ms = 0_u32;
        match self.state {
            DOWNLOAD_SYNC => {
                let leaves = matches!(self.work, Some(Work::Leave));
                self.state = if leaves { MANIFEST } else { DOWNLOAD_BUSY };
                wait_ms = if matches!(self.work, Some(Work::Erase(_))) { 800 } else { 5 };
                if leaves {
                    self.work = None;
                    self.has_left = true;
                }
            }
            DOWNLOAD_BUSY if !self.faults.hangs => match self.work.take().map_or(Ok(()), |work| self.do_work(work)) {
                Ok(()) => self.state = DOWNLOAD_IDLE,
                Err(error) => (self.state, self.error) = (ERROR, error),
            },
            _ => {}
        }
        let [low, middle, high, _] = wait_ms.to_le_bytes();
        Ok([self.error, low, middle, high, self.state, 0])
    }

    fn clear_status(&mut self) -> Result<(), Stalled> {
        self.count()?;
        if self.state != ERROR {
            return self.stall();
        }
        (self.state, self.error) = (IDLE, 0);
        Ok(())
    }

    fn abort(&mut self) -> Result<(), Stalled> {
        self.count()?;
        if ![IDLE, DOWNLOAD_IDLE, UPLOAD_IDLE].contains(&self.state) {
            return self.stall();
        }
        self.state = IDLE;
        Ok(())
    }

    fn wait(&mut self, time: Duration) {
        self.waited += time;
    }
}
