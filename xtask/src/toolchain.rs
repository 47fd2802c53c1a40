//! Which compiler builds the image.
//!
//! A rustup toolchain with the target installed builds it as it is. Where the target cannot be had, a compiler that
//! brings the sources of `core` (Debian's `rustc-web` with `rust-web-src`, or rustup's `rust-src`) builds `core` too.
//! All of this is environment and arguments of one command: no committed configuration file knows of it.

use std::env;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use crate::image::TARGET;

/// Where cargo finds flags for the compiler, whatever characters are in them. It takes the place of flags that are
/// meant for this computer's own programs.
const FLAGS: &str = "CARGO_ENCODED_RUSTFLAGS";

/// Clippy for the operating system's compiler.
const SYSTEM_CLIPPY: &str = "/usr/bin/cargo-clippy";

/// The package whose program is the image.
const PACKAGE: &str = "palpate-firmware-board";

/// What to do where nothing can build it.
pub(crate) const REMEDY: &str = "install the target with `rustup target add thumbv7em-none-eabihf`, or on Debian a compiler \
                          with sources: `apt-get install rustc-web cargo-web rust-web-src`";

/// A compiler that can build the image.
#[derive(Debug)]
enum Toolchain {
    /// It has the target's `core`.
    WithTarget,
    /// It has the sources of `core`.
    WithSources { rustc: PathBuf, cargo: PathBuf, linker: PathBuf },
}

impl Toolchain {
    /// Has cargo bring the sources of dependencies: only then is it known where it keeps them. A failure is told by the
    /// build that follows.
    fn fetch(&self, target: &str) {
        let mut command = match self {
            Self::WithTarget => Command::new(own_cargo()),
            Self::WithSources { cargo, .. } => Command::new(cargo),
        };
        command.args(["fetch", "--quiet", "--locked", "--target", target]).stdout(Stdio::null()).stderr(Stdio::null());
        let _ = command.status();
    }
}

/// The command that runs cargo on the image's package; `None` if no compiler can build it, or it has no clippy where
/// that is asked for.
#[must_use]
pub(crate) fn cargo(subcommand: &str, target_folder: &Path) -> Option<Command> {
    let mut command = cargo_for(TARGET, subcommand, target_folder)?;
    command.args(["--package", PACKAGE, "--profile", "firmware"]);
    command.env(FLAGS, remap(&source_folders()));
    if env::var_os("DEFMT_LOG").is_none() {
        // defmt's own default is `error`: every other line would be missing from the image.
        command.env("DEFMT_LOG", "info");
    }
    Some(command)
}

/// The command that runs cargo for a target without an operating system; `None` as in [`cargo`].
#[must_use]
pub(crate) fn cargo_for(target: &str, subcommand: &str, target_folder: &Path) -> Option<Command> {
    let toolchain = find(target)?;
    let mut command = match &toolchain {
        Toolchain::WithTarget => Command::new(own_cargo()),
        // By its own name, or the operating system's cargo would take rustup's.
        Toolchain::WithSources { rustc, .. } if subcommand == "clippy" && *rustc == system() => {
            Command::new(Path::new(SYSTEM_CLIPPY).is_file().then_some(SYSTEM_CLIPPY)?)
        }
        Toolchain::WithSources { cargo, .. } => Command::new(cargo),
    };
    command.args([subcommand, "--target", target]).arg("--target-dir").arg(target_folder);
    toolchain.fetch(target);
    if let Toolchain::WithSources { rustc, linker, .. } = toolchain {
        command.arg("-Zbuild-std=core").env("RUSTC_BOOTSTRAP", "1").env("RUSTC", &rustc);
        let variable = target.to_uppercase().replace(['-', '.'], "_");
        command.env(format!("CARGO_TARGET_{variable}_LINKER"), linker);
        if rustc == system() {
            // rustup, if this runs under it, would put its own compiler back.
            command.env_remove("RUSTUP_TOOLCHAIN").env_remove("RUSTC_WRAPPER").env("CARGO", system_cargo());
        }
    }
    Some(command)
}

/// Where a panic's place is told, dependencies are named without the folders that hold their sources: they are others on
/// every computer, and take a kilobyte of flash.
fn remap(folders: &[PathBuf]) -> String {
    let flags = folders.iter().map(|folder| format!("--remap-path-prefix={}=", folder.join("").display()));
    // Cargo parts the flags of this variable by a unit separator.
    flags.collect::<Vec<_>>().join("\x1f")
}

/// The folders in which cargo keeps the sources of dependencies: one for each registry and each of its addresses.
fn source_folders() -> Vec<PathBuf> {
    let home = env::var_os("CARGO_HOME").map(PathBuf::from).or_else(|| Some(env::home_dir()?.join(".cargo")));
    let sources = home.unwrap_or_default().join("registry").join("src");
    let mut folders: Vec<_> = sources.read_dir().into_iter().flatten().flatten().map(|entry| entry.path()).collect();
    folders.sort();
    folders
}

fn find(target: &str) -> Option<Toolchain> {
    let own = PathBuf::from("rustc");
    if answer(&own, &["--print", "target-libdir", "--target", target]).is_some_and(|folder| has_core(&folder)) {
        return Some(Toolchain::WithTarget);
    }
    let linker = [&own, &system()].into_iter().find_map(|rustc| linker_of(rustc))?;
    let with_sources = |rustc: PathBuf, cargo: PathBuf| {
        let sources = answer(&rustc, &["--print", "sysroot"])?.join("lib/rustlib/src/rust/library/core");
        sources.is_dir().then(|| Toolchain::WithSources { rustc, cargo, linker: linker.clone() })
    };
    with_sources(own, own_cargo()).or_else(|| with_sources(system(), system_cargo()))
}

/// The cargo that runs this program.
pub(crate) fn own_cargo() -> PathBuf {
    PathBuf::from(env::var_os("CARGO").unwrap_or_else(|| "cargo".into()))
}

/// The compiler of the operating system, beside which rustup's comes first in the path.
fn system() -> PathBuf {
    PathBuf::from("/usr/bin/rustc")
}

/// Its cargo.
fn system_cargo() -> PathBuf {
    PathBuf::from("/usr/bin/cargo")
}

/// What a compiler prints, as a path; `None` if it does not run or fails.
fn answer(rustc: &Path, arguments: &[&str]) -> Option<PathBuf> {
    let output = Command::new(rustc).args(arguments).stderr(Stdio::null()).output().ok()?;
    let line = String::from_utf8(output.stdout).ok()?;
    output.status.success().then(|| PathBuf::from(line.trim()))
}

fn has_core(folder: &Path) -> bool {
    let Ok(entries) = folder.read_dir() else { return false };
    entries.flatten().any(|entry| entry.file_name().to_string_lossy().starts_with("libcore-"))
}

/// The linker that comes with a compiler.
fn linker_of(rustc: &Path) -> Option<PathBuf> {
    let hosts = answer(rustc, &["--print", "sysroot"])?.join("lib/rustlib").read_dir().ok()?;
    let linkers = hosts.flatten().map(|host| host.path().join("bin").join("rust-lld"));
    linkers.map(|linker| linker.with_extension(env::consts::EXE_EXTENSION)).find(|linker| linker.is_file())
}
