//! `cargo xtask firmware build|flash|emulate|size`: one front door to the board's image.

use std::env;
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

use crate::dist;
use crate::emulator::{self, Serial};
use crate::image::{self, Image, TARGET};
use crate::toolchain;

/// Most flash that the image may take, in bytes: an eighth of the chip's 1 MiB. No slot ends there; what goes beyond
/// should have been noticed.
const FLASH_MAX: u32 = 128 * 1024;

/// Most RAM, stack included, in bytes.
const RAM_MAX: u32 = 32 * 1024;

/// The chip, as probe-rs names it.
const CHIP: &str = "STM32F405RG";

/// The program that writes the flash.
const PROBE: &str = "probe-rs";

/// Where the end-to-end test finds the image.
const IMAGE_VARIABLE: &str = "PALPATE_FIRMWARE";

/// How the firmware commands are used.
pub(crate) const USAGE: &str = "       cargo xtask firmware build            build the board's image
       cargo xtask firmware lint             check the code that only the board's target compiles
       cargo xtask firmware ports            check that the core compiles for other processors than the board's
       cargo xtask firmware flash            build it and put it onto a board, through a debug probe
       cargo xtask firmware emulate [--pty]  build it and run it in the emulator, until interrupted
       cargo xtask firmware emulate --test   build it for each converter and run the end-to-end test on it
       cargo xtask firmware size             build it for each converter, print sizes, count instructions in the emulator";

/// Names the converter that an image is built for.
const FRONT_END_VARIABLE: &str = "PALPATE_FRONT_END";

/// Exit status where no compiler builds for the board, by sysexits.h "unavailable".
const NO_COMPILER: u8 = 69;

/// A command that failed; it has said why. Holds the exit status.
pub(crate) struct Failed(u8);

/// Runs one firmware command; `None` if there is no such one.
pub(crate) fn run(words: &[&str]) -> Option<ExitCode> {
    let result = match words {
        ["build"] => build().map(|image| println!("{}", image.display())),
        ["lint"] => lint(),
        ["ports"] => ports(),
        ["flash"] => build().and_then(|image| flash(&image)),
        ["emulate"] => build().and_then(|image| emulate(&image, false)),
        ["emulate", "--pty"] => build().and_then(|image| emulate(&image, true)),
        ["emulate", "--test"] => for_each_front_end(|image| test(image, &[])),
        ["size"] => for_each_front_end(size),
        _ => return None,
    };
    Some(result.map_or_else(|Failed(status)| ExitCode::from(status), |()| ExitCode::SUCCESS))
}

/// Says what went wrong.
fn fail<T>(message: &str) -> Result<T, Failed> {
    eprintln!("error: {message}");
    Err(Failed(1))
}

/// Runs a command to its end.
fn finish(command: &mut Command) -> Result<(), Failed> {
    let program = command.get_program().to_string_lossy().into_owned();
    match command.status() {
        Ok(status) if status.success() => Ok(()),
        Ok(status) => fail(&format!("{program} ended with {status}")),
        Err(error) => fail(&format!("cannot start {program}: {error}")),
    }
}

/// Cargo's target folder.
fn target_folder() -> PathBuf {
    let workspace = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    env::var_os("CARGO_TARGET_DIR").map_or_else(|| workspace.join("target"), PathBuf::from)
}

/// Checks the code that only the board's own target compiles; where nothing here can, says so and is content.
pub(crate) fn lint() -> Result<(), Failed> {
    let Some(mut cargo) = toolchain::cargo("clippy", &image::folder_in(&target_folder())) else {
        eprintln!("the board's own code was not checked: no compiler with clippy here builds for {TARGET}");
        return Ok(());
    };
    eprintln!("+ cargo clippy for {TARGET}");
    finish(cargo.args(["--package", "palpate-firmware-usb", "--", "-D", "warnings"]))
}

/// Processors that the firmware's core has to compile for, so that another board needs a board package only: Cortex-M0
/// (no compare-and-swap), Cortex-M33, and a RISC-V without atomic instructions.
const PORTS: [&str; 3] = ["thumbv6m-none-eabi", "thumbv8m.main-none-eabihf", "riscv32imc-unknown-none-elf"];

/// Compiles the core, its log lines and the simulated finger too, for every one of [`PORTS`].
fn ports() -> Result<(), Failed> {
    for target in PORTS {
        let Some(mut cargo) = toolchain::cargo_for(target, "check", &image::folder_in(&target_folder())) else {
            return fail(&format!("no compiler here builds for {target}; {}", toolchain::REMEDY))
                .map_err(|Failed(_)| Failed(NO_COMPILER));
        };
        cargo.args(["--package", "palpate-firmware-core", "--package", "palpate-shared"]);
        cargo.args(["--features", "palpate-firmware-core/defmt,palpate-shared/sim"]);
        finish(&mut cargo)?;
        println!("{target}: compiles");
    }
    Ok(())
}

/// Builds the image.
fn build() -> Result<PathBuf, Failed> {
    build_with(&[])
}

/// Builds the image with variables set.
fn build_with(variables: &[(&str, &str)]) -> Result<PathBuf, Failed> {
    let target = target_folder();
    let Some(mut cargo) = toolchain::cargo("build", &image::folder_in(&target)) else {
        return fail(&format!("no compiler here builds for {TARGET}; {}", toolchain::REMEDY))
            .map_err(|Failed(_)| Failed(NO_COMPILER));
    };
    finish(cargo.envs(variables.iter().copied()))?;
    Ok(image::path_in(&target))
}

/// Builds the image for one converter after the other, and does something with each.
fn for_each_front_end(mut work: impl FnMut(&Path) -> Result<(), Failed>) -> Result<(), Failed> {
    for front_end in dist::FRONT_ENDS {
        let image = build_with(&[(FRONT_END_VARIABLE, front_end)])?;
        println!("{front_end}");
        work(&image)?;
    }
    Ok(())
}

/// Builds the tool as releases have it: with what is off by default too.
fn tool() -> Result<PathBuf, String> {
    let arguments = ["build", "--release", "--package", "palpate-cli", "--all-features"];
    finish(Command::new(toolchain::own_cargo()).args(arguments)).map_err(|_| "the tool was not built".to_owned())?;
    Ok(target_folder().join("release").join(format!("palpate{}", env::consts::EXE_SUFFIX)))
}

/// Builds the tool and the images of a release.
pub(crate) fn dist() -> Result<(), Failed> {
    let folder = dist::write(&target_folder(), tool, |front_end| {
        // For the build that follows, which is of this process alone.
        let image = build_with(&[(FRONT_END_VARIABLE, front_end)])
            .map_err(|Failed(_)| format!("the image for the {front_end} was not built"))?;
        let contents = image::flash_contents(&image).map_err(|error| format!("{}: {error}", image.display()))?;
        Ok((image, contents))
    });
    match folder {
        Ok(folder) => {
            println!("{}", folder.display());
            Ok(())
        }
        Err(error) => fail(&error),
    }
}

/// Puts the image onto a board and shows its log.
fn flash(image: &Path) -> Result<(), Failed> {
    if Command::new(PROBE).arg("--version").output().is_err() {
        return fail(
            "probe-rs is not installed: `cargo install probe-rs-tools --locked`, and see https://probe.rs for \
                     the permissions that a debug probe needs. Without a probe, the chip's own USB loader does it: \
                     docs/HARDWARE.md, \"Flashing without a probe\"",
        );
    }
    finish(Command::new(PROBE).args(["run", "--chip", CHIP]).arg(image))
}

/// The machine to emulate.
fn machine() -> Result<&'static str, Failed> {
    match emulator::machine() {
        Some(machine) => Ok(machine),
        None => fail(
            "no emulator with an STM32F405: install qemu-system-arm 7.2 or newer \
                      (Debian: `apt-get install qemu-system-arm`)",
        ),
    }
}

/// Runs the image in the emulator until interrupted.
fn emulate(image: &Path, as_pty: bool) -> Result<(), Failed> {
    let machine = machine()?;
    let serial = if as_pty { Serial::Pty } else { Serial::Tcp { port: free_port()?, wait: false } };
    match serial {
        Serial::Tcp { port, .. } => println!("emulating {machine}; try: palpate info --device tcp:127.0.0.1:{port}"),
        Serial::Pty => {
            println!("emulating {machine}; the emulator names the terminal: palpate info --device /dev/pts/N")
        }
    }
    println!("it has no sensor: `palpate info --source simulated` switches to its simulated finger. Ctrl-C ends it.");
    finish(&mut emulator::command(machine, image, serial))
}

/// A TCP port that nobody uses.
fn free_port() -> Result<u16, Failed> {
    match TcpListener::bind("127.0.0.1:0").and_then(|listener| listener.local_addr()) {
        Ok(address) => Ok(address.port()),
        Err(error) => fail(&format!("no free TCP port: {error}")),
    }
}

/// Runs the end-to-end test on an image.
fn test(image: &Path, arguments: &[&str]) -> Result<(), Failed> {
    machine()?;
    let mut cargo = Command::new(env::var("CARGO").unwrap_or_else(|_| "cargo".to_owned()));
    cargo.args(["test", "--package", "palpate-tests", "--test", "emulator", "--"]).args(arguments);
    finish(cargo.env(IMAGE_VARIABLE, image))
}

/// Prints an image's size, and how many instructions a sample takes; fails if a limit is broken.
fn size(image: &Path) -> Result<(), Failed> {
    let found = match Image::read(image) {
        Ok(found) => found,
        Err(error) => return fail(&format!("{}: {error}", image.display())),
    };
    let ram = found.variables + found.stack;
    println!("flash  {:6} bytes, at most {FLASH_MAX}", found.flash);
    println!("RAM    {ram:6} bytes, at most {RAM_MAX}: {} of variables, {} of stack", found.variables, found.stack);
    println!("double precision: {} functions", found.double_precision.len());
    println!("log    {:6} lines", found.log_lines.len());
    if !found.log_lines.iter().any(|(_, line)| line.contains("defmt_info")) {
        return fail("no log line at level info is in the image: DEFMT_LOG must be `info` or lower when it is built");
    }
    if !found.double_precision.is_empty() {
        return fail(&format!("double-precision arithmetic, which the processor lacks: {:?}", found.double_precision));
    }
    if found.flash > FLASH_MAX || ram > RAM_MAX {
        return fail("the image is too large");
    }
    if emulator::machine().is_none() {
        eprintln!("instructions were not counted: {} is not installed", emulator::PROGRAM);
        return Ok(());
    }
    test(image, &["--nocapture", "the_sampling_path_stays_within_its_share_of_the_processor"])
}
