//! The chip's own USB loader: an image onto a board without a debug probe.
//!
//! [`FirmwareFile`] is what a file has to be before anything is erased; [`flash`] speaks the loader's protocol over a
//! [`DfuPort`], erases what the image needs, writes it, reads it back, and starts it. What the image leaves free, such as where
//! the board keeps the matrix of its forces, is left as it is. Tested against a loader in memory ([`simulated`]), which
//! checks the order of requests; `usb` (feature `usb`) finds loaders that are plugged in. **No test has spoken to a chip over USB.**
//!
//! Implements: DFU 1.1 (requests, states, the suffix of files), and ST's extension of it (AN3156: set address and erase are
//! downloads with block number 0, data have numbers from 2 on). Sectors: STM32F405 (RM0090, table 5).
//! Errors: [`NotAFirmware`], [`FlashError`].

mod elf;
mod file;
pub mod simulated;
#[cfg(test)]
mod tests;
#[cfg(feature = "usb")]
pub mod usb;

pub use file::{FirmwareFile, NotAFirmware};

use std::time::Duration;

/// Vendor and product of the chip's loader.
pub const LOADER: (u16, u16) = (0x0483, 0xDF11);

/// Where the chip's flash begins.
pub const FLASH_START: u32 = 0x0800_0000;

/// Its size, in bytes.
pub const FLASH_BYTES: u32 = 1024 * 1024;

/// Sizes of its sectors, in KiB, in order.
const SECTORS_KIB: [u32; 12] = [16, 16, 16, 16, 64, 128, 128, 128, 128, 128, 128, 128];

/// The loader's transfers, in bytes: what its descriptor says (AN3156).
const TRANSFER_BYTES: usize = 2048;

/// Block number of the first data.
const FIRST_DATA_BLOCK: u16 = 2;

/// Looks at a busy loader before it is given up: each is as long as it asks for. Erasing 128 KiB takes 4 s at most
/// (datasheet, table 41), which the loader tells in one or several waits.
const BUSY_LOOKS_MAX: u32 = 200;

/// Longest wait between two looks, whatever the loader asks for.
const WAIT_MAX: Duration = Duration::from_secs(5);

/// A loader's state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum State {
    /// It waits for an order.
    Idle,
    /// It took a download, and waits to be asked how that went.
    DownloadSync,
    /// It is at work.
    DownloadBusy,
    /// It waits for the next download.
    DownloadIdle,
    /// It is about to start what was written.
    Manifest,
    /// It waits for the next upload.
    UploadIdle,
    /// Something went wrong; it waits to be told that this was noted.
    Error,
    /// Any other, by its number.
    Other(u8),
}

/// What a loader says of itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Status {
    /// 0, or what went wrong, by its number (DFU 1.1, section 6.1.2).
    pub error: u8,
    /// How long to wait before the next look.
    pub wait: Duration,
    /// Its state.
    pub state: State,
}

impl Status {
    /// Takes the six bytes of the answer apart.
    #[must_use]
    pub fn of([error, low, middle, high, state, _]: [u8; 6]) -> Self {
        let state = match state {
            2 => State::Idle,
            3 => State::DownloadSync,
            4 => State::DownloadBusy,
            5 => State::DownloadIdle,
            6..=8 => State::Manifest,
            9 => State::UploadIdle,
            10 => State::Error,
            other => State::Other(other),
        };
        Self { error, wait: Duration::from_millis(u32::from_le_bytes([low, middle, high, 0]).into()), state }
    }
}

/// The way to a loader: its control requests.
pub trait DfuPort {
    /// Why a request failed.
    type Error: std::error::Error;

    /// How the loader names the memory that it writes, and its sectors: the name of its interface (AN3156's and UM0424's
    /// form: `@Internal Flash  /0x08000000/04*016Kg,01*064Kg,07*128Kg`).
    ///
    /// # Errors
    /// If it does not say.
    fn memory(&mut self) -> Result<String, Self::Error>;

    /// `DFU_DNLOAD`.
    ///
    /// # Errors
    /// If the loader refuses, or is gone.
    fn download(&mut self, block: u16, data: &[u8]) -> Result<(), Self::Error>;

    /// `DFU_UPLOAD`; how many bytes came.
    ///
    /// # Errors
    /// Likewise.
    fn upload(&mut self, block: u16, into: &mut [u8]) -> Result<usize, Self::Error>;

    /// `DFU_GETSTATUS`.
    ///
    /// # Errors
    /// Likewise.
    fn status(&mut self) -> Result<[u8; 6], Self::Error>;

    /// `DFU_CLRSTATUS`.
    ///
    /// # Errors
    /// Likewise.
    fn clear_status(&mut self) -> Result<(), Self::Error>;

    /// `DFU_ABORT`.
    ///
    /// # Errors
    /// Likewise.
    fn abort(&mut self) -> Result<(), Self::Error>;

    /// Lets time pass.
    fn wait(&mut self, time: Duration);
}

/// Why an image did not get onto a board. Before [`Step::Starting`] the board has no image that runs; its loader is there
/// still.
#[derive(Debug, thiserror::Error)]
pub enum FlashError<E> {
    /// A request failed.
    #[error("the loader did not take a request while {step}: {source}")]
    Port {
        /// What was being done.
        step: Step,
        /// Why it failed.
        source: E,
    },
    /// The loader is that of another chip.
    #[error(
        "the loader is of another chip: it names its memory {memory:?}, an STM32F405RG's has 4 sectors of 16 KiB, 1 of 64 and 7 of 128"
    )]
    OtherChip {
        /// What it calls its memory.
        memory: String,
    },
    /// The loader reports an error.
    #[error("the loader reports error {error} while {step}: {}", meaning(*error))]
    Refused {
        /// What was being done.
        step: Step,
        /// Its number.
        error: u8,
    },
    /// The loader is in a state in which it should not be.
    #[error("the loader is in state {state:?} while {step}, out of turn")]
    OutOfTurn {
        /// What was being done.
        step: Step,
        /// The state.
        state: State,
    },
    /// The loader stays busy.
    #[error("the loader is still busy {step} after {looks} looks")]
    Busy {
        /// What was being done.
        step: Step,
        /// How often it was looked at.
        looks: u32,
    },
    /// What was read back is not what was written.
    #[error("at {address:#010x} the flash holds {found:#04x}, and {wanted:#04x} was written")]
    Different {
        /// Where.
        address: u32,
        /// What is there.
        found: u8,
        /// What was to be there.
        wanted: u8,
    },
}

/// What is being done.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// Bringing the loader to rest.
    Beginning,
    /// Erasing the sector at this address.
    Erasing(u32),
    /// Writing at this address.
    Writing(u32),
    /// Reading back at this address.
    Reading(u32),
    /// Starting the image.
    Starting,
}

impl std::fmt::Display for Step {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Beginning => f.write_str("being brought to rest"),
            Self::Erasing(address) => write!(f, "erasing at {address:#010x}"),
            Self::Writing(address) => write!(f, "writing at {address:#010x}"),
            Self::Reading(address) => write!(f, "reading at {address:#010x}"),
            Self::Starting => f.write_str("starting the image"),
        }
    }
}

/// What an error of a loader means.
fn meaning(error: u8) -> &'static str {
    match error {
        1 => "the file is not for this device",
        3 => "the memory cannot be written",
        4 => "erasing failed",
        6 => "writing failed",
        7 => "what was written reads otherwise",
        8 => "the address is out of range, or write-protected",
        _ => "see DFU 1.1, section 6.1.2",
    }
}

/// What an erased byte reads.
const ERASED: u8 = 0xFF;

/// The sectors that an image needs: where each begins, and what it is to hold, as far as the image reaches. Those that it leaves
/// free are none of them.
fn sectors(image: &[u8]) -> impl Iterator<Item = (u32, &[u8])> {
    let mut rest = image;
    let all = SECTORS_KIB.into_iter().scan(FLASH_START, move |end, kib| {
        let begin = *end;
        *end += kib * 1024;
        let (here, behind) = rest.split_at(rest.len().min(kib as usize * 1024));
        rest = behind;
        Some((begin, here))
    });
    all.filter(|(_, bytes)| bytes.iter().any(|&byte| byte != ERASED))
}

/// Where each transfer of an image goes, and what it brings.
fn transfers(image: &[u8]) -> impl Iterator<Item = (u32, &[u8])> {
    sectors(image).flat_map(|(begin, bytes)| (begin..).step_by(TRANSFER_BYTES).zip(bytes.chunks(TRANSFER_BYTES)))
}

/// How many steps [`flash`] tells of.
#[must_use]
pub fn steps(file: &FirmwareFile) -> usize {
    sectors(file.bytes()).count() + 2 * transfers(file.bytes()).count() + 1
}

/// How many sectors an image needs.
#[must_use]
pub fn sectors_needed(file: &FirmwareFile) -> usize {
    sectors(file.bytes()).count()
}

/// The sizes of the sectors that a loader names, in KiB; `None` if that cannot be read.
fn named_sectors(memory: &str) -> Option<Vec<u32>> {
    let (_, place) = memory.split_once('/')?;
    let (start, sectors) = place.trim().split_once('/')?;
    if u32::from_str_radix(start.trim().strip_prefix("0x")?, 16).ok()? != FLASH_START {
        return None;
    }
    let mut sizes = Vec::new();
    for group in sectors.split(',') {
        let (count, size) = group.trim().split_once('*')?;
        let (size, in_kib) = size.split_at_checked(size.find(|letter: char| !letter.is_ascii_digit())?)?;
        let kib = size.parse::<u32>().ok()? * if in_kib.starts_with('K') { 1 } else { return None };
        // No chip has more; a name that says so is none.
        let count = count.parse::<usize>().ok().filter(|count| *count <= 1024)?;
        sizes.extend(std::iter::repeat_n(kib, count));
    }
    Some(sizes)
}

/// Puts an image onto the board behind a loader: erases the sectors that it needs, writes it, reads it back, and starts
/// it. Tells each step before it is taken, [`steps`] in all.
///
/// # Errors
/// [`FlashError`].
pub fn flash<P: DfuPort>(
    port: &mut P,
    file: &FirmwareFile,
    mut tell: impl FnMut(Step),
) -> Result<(), FlashError<P::Error>> {
    let mut loader = Loader { port, step: Step::Beginning };
    loader.check_chip()?;
    loader.rest()?;
    let bytes = file.bytes();
    for (address, _) in sectors(bytes) {
        tell(loader.begin(Step::Erasing(address)));
        loader.order(0x41, address)?;
    }
    for (address, data) in transfers(bytes) {
        tell(loader.begin(Step::Writing(address)));
        loader.order(0x21, address)?;
        loader.download(FIRST_DATA_BLOCK, data)?;
    }
    for (address, data) in transfers(bytes) {
        tell(loader.begin(Step::Reading(address)));
        loader.compare(address, data)?;
    }
    tell(loader.begin(Step::Starting));
    loader.start()
}

/// A loader at work on one step.
struct Loader<'p, P> {
    port: &'p mut P,
    step: Step,
}

impl<P: DfuPort> Loader<'_, P> {
    fn begin(&mut self, step: Step) -> Step {
        self.step = step;
        step
    }

    fn failed(&self, source: P::Error) -> FlashError<P::Error> {
        FlashError::Port { step: self.step, source }
    }

    fn status(&mut self) -> Result<Status, FlashError<P::Error>> {
        let bytes = self.port.status().map_err(|source| self.failed(source))?;
        Ok(Status::of(bytes))
    }

    /// Other chips of the same maker have the same loader, and other sectors.
    fn check_chip(&mut self) -> Result<(), FlashError<P::Error>> {
        let memory = self.port.memory().map_err(|source| self.failed(source))?;
        let is_ours = named_sectors(&memory).is_some_and(|sizes| sizes == SECTORS_KIB);
        if is_ours { Ok(()) } else { Err(FlashError::OtherChip { memory }) }
    }

    /// Brings it to rest, whatever somebody before left.
    fn rest(&mut self) -> Result<(), FlashError<P::Error>> {
        let state = self.status()?.state;
        match state {
            State::Idle => return Ok(()),
            State::Error => self.port.clear_status().map_err(|source| self.failed(source))?,
            _ => self.port.abort().map_err(|source| self.failed(source))?,
        }
        match self.status()? {
            Status { state: State::Idle, .. } => Ok(()),
            Status { state, .. } => Err(FlashError::OutOfTurn { step: self.step, state }),
        }
    }

    /// A download, and the wait until it is done.
    fn download(&mut self, block: u16, data: &[u8]) -> Result<(), FlashError<P::Error>> {
        self.port.download(block, data).map_err(|source| self.failed(source))?;
        for _ in 0..BUSY_LOOKS_MAX {
            match self.status()? {
                Status { error, .. } if error != 0 => return Err(FlashError::Refused { step: self.step, error }),
                Status { state: State::DownloadIdle, .. } => return Ok(()),
                Status { state: State::DownloadBusy | State::DownloadSync, wait, .. } => {
                    self.port.wait(wait.min(WAIT_MAX));
                }
                Status { state, .. } => return Err(FlashError::OutOfTurn { step: self.step, state }),
            }
        }
        Err(FlashError::Busy { step: self.step, looks: BUSY_LOOKS_MAX })
    }

    /// An order with an address.
    fn order(&mut self, order: u8, address: u32) -> Result<(), FlashError<P::Error>> {
        let [a, b, c, d] = address.to_le_bytes();
        self.download(0, &[order, a, b, c, d])
    }

    /// Reads back what was written.
    fn compare(&mut self, address: u32, data: &[u8]) -> Result<(), FlashError<P::Error>> {
        // The address is set by a download; uploads begin at rest.
        self.rest()?;
        self.order(0x21, address)?;
        self.rest()?;
        let mut found = vec![0; data.len()];
        let length = self.port.upload(FIRST_DATA_BLOCK, &mut found).map_err(|source| self.failed(source))?;
        found.truncate(length);
        let state = self.status()?;
        if state.error != 0 {
            return Err(FlashError::Refused { step: self.step, error: state.error });
        }
        let places = (address..).zip(data.iter().zip(found.iter().map(Some).chain(std::iter::repeat(None))));
        for (address, (&wanted, found)) in places {
            // What did not come reads as erased.
            let found = found.copied().unwrap_or(0xFF);
            if found != wanted || length < data.len() {
                return Err(FlashError::Different { address, found, wanted });
            }
        }
        Ok(())
    }

    /// Has it leave for the image. A loader that went at once does not answer any more.
    fn start(&mut self) -> Result<(), FlashError<P::Error>> {
        self.rest()?;
        self.order(0x21, FLASH_START)?;
        self.port.download(FIRST_DATA_BLOCK, &[]).map_err(|source| self.failed(source))?;
        match self.port.status().map(Status::of) {
            Ok(Status { error, .. }) if error != 0 => Err(FlashError::Refused { step: self.step, error }),
            Ok(_) | Err(_) => Ok(()),
        }
    }
}
