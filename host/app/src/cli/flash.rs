//! `palpate flash`.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};

use miette::{IntoDiagnostic as _, WrapErr as _};
use palpate_device::dfu::simulated::{Faults, Loader};
use palpate_device::dfu::usb::{self, FoundLoader, UsbError};
use palpate_device::dfu::{self, DfuPort, FirmwareFile, FlashError, LOADER, NotAFirmware, Step};
use palpate_device::session::{Session, SessionOptions};
use palpate_device::transport::Address;

use crate::advice::Advise as _;
use crate::progress::{self, Progress};
use crate::recording::checksum;

/// Puts an image onto a board, by USB and without a debug probe, through the loader that its chip was made with.
///
/// UNTRIED ON USB HARDWARE: what is sent was tested against a loader in memory only. A board whose image does not run can
/// always be flashed again by BOOT0 and RST, or by a probe (docs/HARDWARE.md).
///
/// The file is a .dfu or ELF file of a release, an ELF file that was built, or bare contents of the flash (.bin). It is
/// refused where it is damaged, not for this chip or not palpate's; then nothing is erased. SHA256SUMS beside it is
/// checked if it names the file. What is written is read back.
///
/// Exit status: 0 written and started, 1 not, 64 wrong command line.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// The image: .dfu, ELF or .bin
    #[arg(value_name = "FILE")]
    file: PathBuf,

    /// Restart this device into its loader first: serial port, tcp:HOST:PORT, or sim: to try all of it without a board
    /// [default: a board that is in its loader, by BOOT0 and RST]
    #[arg(long, short = 'd', value_name = "DEVICE")]
    device: Option<String>,

    /// Speed of its serial line in baud [default: 921600, then 115200]
    #[arg(long, value_name = "BAUD", requires = "device")]
    baud: Option<u32>,

    /// The loader's serial number, where several are plugged in
    #[arg(long, value_name = "NUMBER", conflicts_with = "device")]
    serial: Option<String>,

    /// Check the file and write nothing
    #[arg(long)]
    dry_run: bool,
}

/// How long a device has to come back as a loader: the reset takes milliseconds, the computer a second or two.
const LOADER_WAIT: Duration = Duration::from_secs(10);

/// How often it is looked for.
const LOOK_EVERY: Duration = Duration::from_millis(200);

/// The state in which a loader begins.
const DFU_IDLE: u8 = 2;

/// What a release calls the list of its files' checksums.
const SUMS: &str = "SHA256SUMS";

/// What to do where a loader was not reached, or left half way.
const AGAIN: &str =
    "the loader is still there: repeat it, or hold BOOT0 high and BOOT1 low, press RST and repeat it without -d";

pub(crate) fn run(arguments: &Arguments) -> miette::Result<ExitCode> {
    let (image, whole) = read(&arguments.file)?;
    let sectors = super::counted(dfu::sectors_needed(&image), "sector");
    say!("{}: {} bytes in {sectors}, {}", name_of(&arguments.file), image.bytes().len(), whole.in_words());
    if arguments.dry_run {
        say!("nothing was written (--dry-run)");
        return Ok(ExitCode::SUCCESS);
    }
    let address = arguments.device.as_ref().map(|name| name.parse::<Address>().advised()).transpose()?;
    let begun = Instant::now();
    if let Some(address @ Address::Simulated { .. }) = &address {
        enter_loader(address, None)?;
        write(&mut Loader::new(DFU_IDLE, Faults::default()), &image)?;
        say!("SIMULATED: written to a loader in memory and read back; no board was touched");
        return Ok(ExitCode::SUCCESS);
    }
    let loader = match &address {
        Some(Address::Recording(_)) => {
            return Err(miette::miette!(help = "name its port", "a recording has no flash to write"));
        }
        Some(address) => after_restart(address, arguments.baud)?,
        None => only_one(usb::loaders().map_err(unreachable)?, arguments.serial.as_deref())?,
    };
    say!("loader {:04x}:{:04x}, serial number {}", LOADER.0, LOADER.1, loader.serial_number());
    write(&mut loader.open().map_err(unreachable)?, &image)?;
    say!("written, read back and started in {:.1} s", begun.elapsed().as_secs_f64());
    Ok(ExitCode::SUCCESS)
}

/// What tells that a file is whole.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Whole {
    /// Its own checksum.
    ByItself,
    /// The list of a release's files.
    ByList,
    /// Nothing.
    Unknown,
}

impl Whole {
    fn in_words(self) -> &'static str {
        match self {
            Self::ByItself => "CRC-32 as stated",
            Self::ByList => "SHA-256 as in SHA256SUMS",
            Self::Unknown => "without a checksum to hold it against",
        }
    }
}

/// Reads an image, and what tells that it is whole.
fn read(path: &Path) -> miette::Result<(FirmwareFile, Whole)> {
    let cannot = || format!("{} is not put onto a board", path.display());
    let file = std::fs::read(path).into_diagnostic().wrap_err_with(cannot)?;
    let has_extension = |wanted: &str| path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case(wanted));
    let listed = check_list(path, &file).wrap_err_with(cannot)?;
    let image = if has_extension("bin") { FirmwareFile::read_bare(&file) } else { FirmwareFile::read(&file) };
    let image = image.map_err(|refused| {
        let help = match refused {
            NotAFirmware::Damaged { .. } | NotAFirmware::NoSuffix => {
                "download it again, or make it by `cargo xtask dist`"
            }
            _ => "`cargo xtask dist` makes the images of a release; nothing was erased",
        };
        miette::miette!(help = help, "{refused}").wrap_err(cannot())
    })?;
    let whole = match (listed, has_extension("dfu")) {
        (true, _) => Whole::ByList,
        (false, true) => Whole::ByItself,
        (false, false) => Whole::Unknown,
    };
    Ok((image, whole))
}

/// Holds a file against the list of checksums beside it; whether it is named there.
fn check_list(path: &Path, file: &[u8]) -> miette::Result<bool> {
    let list = match std::fs::read_to_string(path.with_file_name(SUMS)) {
        Ok(list) => list,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(false),
        Err(error) => return Err(miette::miette!("the {SUMS} beside it cannot be read: {error}")),
    };
    let name = name_of(path);
    // `sha256sum` puts an asterisk before the name of a file that it read as binary.
    let of_line = |line: &str| {
        let (sum, rest) = line.split_once(' ')?;
        (rest.trim_start_matches([' ', '*']) == name).then(|| sum.to_ascii_lowercase())
    };
    let Some(stated) = list.lines().find_map(of_line) else { return Ok(false) };
    let found = checksum(file);
    if found == stated {
        return Ok(true);
    }
    let help = "download it again, or make it by `cargo xtask dist`";
    Err(miette::miette!(help = help, "it is damaged: its SHA-256 is {found}, and {SUMS} states {stated}"))
}

fn name_of(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// Has a device restart into its loader.
fn enter_loader(address: &Address, baud: Option<u32>) -> miette::Result<()> {
    let mut session = Session::open(address, SessionOptions { baud, reconnect: false }).advised()?;
    session.enter_loader().advised()
}

/// The loader that a device becomes.
fn after_restart(address: &Address, baud: Option<u32>) -> miette::Result<FoundLoader> {
    let before = usb::loaders().map_err(unreachable)?;
    enter_loader(address, baud)?;
    let deadline = Instant::now() + LOADER_WAIT;
    loop {
        let there = usb::loaders().map_err(unreachable)?;
        let new = there.into_iter().find(|loader| !before.iter().any(|known| known.is(loader)));
        match new {
            Some(loader) => return Ok(loader),
            None if Instant::now() > deadline => {
                let help = "is the board's own USB socket connected, too? Its loader is not on the serial line";
                let waited = LOADER_WAIT.as_secs();
                return Err(miette::miette!(help = help, "no loader showed up on USB within {waited} s"));
            }
            None => std::thread::sleep(LOOK_EVERY),
        }
    }
}

/// The loader that is meant.
fn only_one(there: Vec<FoundLoader>, serial: Option<&str>) -> miette::Result<FoundLoader> {
    let numbers: Vec<String> = there.iter().map(|loader| loader.serial_number().to_owned()).collect();
    let mut meant = there.into_iter().filter(|loader| serial.is_none_or(|wanted| loader.serial_number() == wanted));
    match (meant.next(), meant.next(), serial) {
        (Some(loader), None, _) => Ok(loader),
        (Some(_), Some(_), _) => {
            let help = format!("choose one by --serial: {}", numbers.join(", "));
            Err(miette::miette!(help = help, "{} loaders are plugged in", numbers.len()))
        }
        (None, _, Some(wanted)) if !numbers.is_empty() => {
            let help = format!("there are: {}", numbers.join(", "));
            Err(miette::miette!(help = help, "no loader has the serial number {wanted}"))
        }
        (None, ..) => {
            let help = "name the device (-d /dev/ttyACM0) to restart it into its loader; or hold BOOT0 high and BOOT1 low \
                        and press RST, with the board's USB connected";
            Err(miette::miette!(help = help, "no board is in its loader"))
        }
    }
}

/// Why a loader cannot be reached, and what to do.
fn unreachable(error: UsbError) -> miette::Report {
    let help =
        if error.is_forbidden() { "docs/udev/70-palpate.rules lets you use it; then plug it in again" } else { AGAIN };
    miette::miette!(help = help, "{error}")
}

/// Writes an image, and shows how far it is.
fn write<P: DfuPort>(port: &mut P, image: &FirmwareFile) -> miette::Result<()> {
    let progress = Progress::begin("writing");
    let (mut done, of) = (0, dfu::steps(image) as u64);
    let written = dfu::flash(port, image, |step| {
        let what = match step {
            Step::Beginning => "beginning",
            Step::Erasing(_) => "erasing",
            Step::Writing(_) => "writing",
            Step::Reading(_) => "reading back",
            Step::Starting => "starting",
        };
        progress::reached(done, of, what);
        done += 1;
    });
    drop(progress);
    written.map_err(|error| {
        let help = match &error {
            FlashError::OtherChip { .. } => "nothing was erased; is another board plugged in?",
            _ => AGAIN,
        };
        miette::miette!(help = help, "{error}")
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image() -> FirmwareFile {
        let mut contents = vec![0x5A_u8; 40_000];
        contents[..8].copy_from_slice(&[0, 0x20, 0, 0x20, 0x99, 1, 0, 8]);
        contents[600..614].copy_from_slice(b"palpate finger");
        FirmwareFile::read_bare(&contents).expect("an image")
    }

    #[test]
    fn what_goes_wrong_says_whether_the_board_is_as_it_was() {
        let mut other = Loader::new(2, Faults::default());
        other.memory = "@Internal Flash /0x08000000/512*001Kg".to_owned();
        let refused = write(&mut other, &image()).unwrap_err();
        assert!(refused.help().is_some_and(|help| help.to_string().starts_with("nothing was erased")), "{refused:?}");
        let mut broken = Loader::new(2, Faults { unplugged_after: Some(30), ..Faults::default() });
        let failed = write(&mut broken, &image()).unwrap_err();
        assert!(failed.help().is_some_and(|help| help.to_string() == AGAIN), "{failed:?}");
        write(&mut Loader::new(2, Faults::default()), &image()).unwrap();
    }

    #[test]
    fn a_list_of_checksums_is_read_as_its_program_writes_it() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.elf");
        assert!(!check_list(&path, b"abc").unwrap(), "no list");
        // FIPS 180-2: SHA-256 of "abc".
        let of_abc = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        for line in [format!("{of_abc}  a.elf\n"), format!("{} *a.elf\n", of_abc.to_uppercase())] {
            std::fs::write(folder.path().join(SUMS), format!("00  b.elf\n{line}")).unwrap();
            assert!(check_list(&path, b"abc").unwrap(), "{line}");
            let damaged = check_list(&path, b"abd").unwrap_err().to_string();
            assert!(damaged.starts_with("it is damaged: its SHA-256 is ") && damaged.contains(of_abc), "{damaged}");
            assert!(!check_list(&folder.path().join("c.elf"), b"abd").unwrap(), "not named");
        }
    }
}
