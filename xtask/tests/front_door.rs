//! The chores with stand-ins for the programs that they start: which are started, how, and what is said where one is
//! missing. The stand-ins are shell scripts that note how they were called.
#![cfg(unix)]

use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;
use std::process::{Command, Output};

use tempfile::TempDir;

/// What the path holds beside the stand-ins: the shell's own few programs.
const SHELL: [&str; 2] = ["bash", "dirname"];

/// `cargo xtask firmware build` ends with this where no compiler is there for it.
const NO_COMPILER: i32 = 69;

/// A folder with stand-ins, and nothing else in the path.
struct Stage {
    folder: TempDir,
}

impl Stage {
    /// A stage with these stand-ins; each notes its arguments and then does what its script says.
    fn new(programs: &[(&str, &str)]) -> Self {
        let stage = Self { folder: tempfile::tempdir().expect("a folder") };
        for program in SHELL {
            let place = ["/bin", "/usr/bin"].map(|folder| Path::new(folder).join(program));
            let found = place.iter().find(|path| path.exists()).expect("a shell");
            std::os::unix::fs::symlink(found, stage.folder.path().join(program)).expect("the folder takes it");
        }
        for (name, script) in programs {
            let (path, calls) = (stage.folder.path().join(name), stage.folder.path().join("calls"));
            let text = format!("#!/bin/sh\necho \"{name} $*\" >> '{}'\n{script}\n", calls.display());
            fs::write(&path, text).expect("the folder takes it");
            fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).expect("the folder takes it");
        }
        stage
    }

    /// A compiler that has the board's target, and a cargo that builds at once.
    fn with_compiler(more: &[(&str, &str)]) -> Self {
        let rustc = "case \"$*\" in *target-libdir*) echo \"${0%/*}/lib\";; *) exit 1;; esac";
        let mut programs = vec![("rustc", rustc), ("cargo", "exit 0")];
        programs.extend(more);
        let stage = Self::new(&programs);
        fs::create_dir(stage.folder.path().join("lib")).expect("the folder takes it");
        fs::write(stage.folder.path().join("lib/libcore-0.rlib"), "").expect("the folder takes it");
        stage
    }

    /// Runs a program with the stage as its path.
    fn run(&self, program: &Path, arguments: &[&str]) -> Output {
        let mut command = Command::new(program);
        command.args(arguments).env("PATH", self.folder.path()).env("CARGO", self.folder.path().join("cargo"));
        command.env("CARGO_TARGET_DIR", self.folder.path().join("target")).output().expect("it starts")
    }

    fn xtask(&self, arguments: &[&str]) -> Output {
        self.run(Path::new(env!("CARGO_BIN_EXE_xtask")), arguments)
    }

    /// How the stand-ins were called, in order.
    fn calls(&self) -> Vec<String> {
        let text = fs::read_to_string(self.folder.path().join("calls")).unwrap_or_default();
        text.lines().map(str::to_owned).collect()
    }
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

#[test]
fn flash_builds_the_image_and_hands_it_to_the_probe_with_the_chips_name() {
    let stage = Stage::with_compiler(&[("probe-rs", "exit 0")]);
    let output = stage.xtask(&["firmware", "flash"]);
    assert!(output.status.success(), "{}", said(&output));
    let calls = stage.calls();
    let build = calls
        .iter()
        .position(|call| call.starts_with("cargo build ") && call.contains(" --package palpate-firmware-board "));
    let image = stage.folder.path().join("target/firmware/thumbv7em-none-eabihf/firmware/palpate-firmware");
    let run = format!("probe-rs run --chip STM32F405RG {}", image.display());
    let flash = calls.iter().position(|call| *call == run);
    assert!(build.is_some() && flash > build, "{calls:#?}");
}

#[test]
fn flash_fails_as_the_probe_does_and_says_what_to_install_where_it_is_missing() {
    let output = Stage::with_compiler(&[("probe-rs", "[ \"$1\" = --version ]")]).xtask(&["firmware", "flash"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(said(&output).contains("probe-rs ended with exit status: 1"), "{}", said(&output));

    let output = Stage::with_compiler(&[]).xtask(&["firmware", "flash"]);
    assert_eq!(output.status.code(), Some(1));
    for wanted in ["probe-rs is not installed", "cargo install probe-rs-tools --locked", "docs/HARDWARE.md"] {
        assert!(said(&output).contains(wanted), "{wanted:?} in {}", said(&output));
    }
}

#[test]
fn an_image_that_does_not_build_is_not_flashed() {
    let stage = Stage::with_compiler(&[("probe-rs", "exit 0"), ("cargo", "exit 101")]);
    assert_eq!(stage.xtask(&["firmware", "flash"]).status.code(), Some(1));
    assert!(!stage.calls().iter().any(|call| call.starts_with("probe-rs")), "{:?}", stage.calls());
}

#[test]
fn without_a_compiler_for_the_board_the_remedy_is_named_and_the_status_tells() {
    let stage = Stage::new(&[("rustc", "exit 1"), ("cargo", "exit 0")]);
    let linker = Path::new("/usr/lib/rustlib/x86_64-unknown-linux-gnu/bin/rust-lld");
    if linker.exists() {
        eprintln!("not run: this computer's own compiler builds for the board, whatever is in the path");
        return;
    }
    let output = stage.xtask(&["firmware", "build"]);
    assert_eq!(output.status.code(), Some(NO_COMPILER), "{}", said(&output));
    assert!(said(&output).contains("rustup target add thumbv7em-none-eabihf"), "{}", said(&output));
    assert!(!stage.calls().iter().any(|call| call.starts_with("cargo")), "{:?}", stage.calls());
}

#[test]
fn emulate_says_what_to_install_where_the_emulator_is_missing_or_too_old() {
    for more in [&[][..], &[("qemu-system-arm", "echo 'mps2-an386 a board'")]] {
        let output = Stage::with_compiler(more).xtask(&["firmware", "emulate"]);
        assert_eq!(output.status.code(), Some(1));
        assert!(said(&output).contains("install qemu-system-arm 7.2 or newer"), "{}", said(&output));
    }
}

#[test]
fn the_checks_install_the_emulator_where_it_is_missing_and_nothing_where_it_is_there() {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../.ci/run");
    let programs = [("apt-get", "exit 0"), ("rustup", "exit 0")];
    let stage = Stage::with_compiler(&programs);
    let output = stage.run(&script, &[]);
    assert!(output.status.success(), "{}", said(&output));
    let calls = stage.calls();
    let installs: Vec<&String> = calls.iter().filter(|call| call.starts_with("apt-get")).collect();
    let install = "apt-get install --yes --no-install-recommends";
    let wanted = ["apt-get update".to_owned(), format!("{install} qemu-system-arm"), format!("{install} chromium")];
    assert_eq!(installs.into_iter().cloned().collect::<Vec<_>>(), wanted);
    assert!(calls.iter().any(|call| call == "cargo xtask lint"), "{calls:#?}");

    let there = [("qemu-system-arm", "exit 0"), ("chromium", "exit 0")];
    let stage = Stage::with_compiler(&[programs[0], programs[1], there[0], there[1]]);
    assert!(stage.run(&script, &[]).status.success());
    assert!(!stage.calls().iter().any(|call| call.starts_with("apt-get")), "{:?}", stage.calls());
}

#[test]
fn the_checks_install_the_reader_of_recordings_where_there_is_python_and_go_on_without() {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../.ci/run");
    let always = [("qemu-system-arm", "exit 0"), ("chromium", "exit 0"), ("rustup", "exit 0")];
    // An environment is a copy of it, into which a package can be had or not.
    let makes = "for last; do :; done; /bin/mkdir -p \"$last/bin\" && /bin/cp \"$0\" \"$last/bin/python\"";
    for (installed, is_there) in [(0, true), (1, false)] {
        let python = format!("case \"$*\" in *venv*) {makes};; *) exit {installed};; esac");
        let stage = Stage::with_compiler(&[always[0], always[1], always[2], ("python3", &python)]);
        let output = stage.run(&script, &[]);
        assert!(output.status.success(), "{}", said(&output));
        let calls = stage.calls();
        for wanted in ["python3 -m venv --clear ", "python3 -m pip install --quiet mcap mcap-ros2-support"] {
            assert!(calls.iter().any(|call| call.starts_with(wanted)), "{wanted}: {calls:#?}");
        }
        assert_eq!(stdout(&output).contains("Python's mcap cannot be installed here"), !is_there);
        let foxglove = "cargo test --features palpate-cli/foxglove --test commands -- foxglove::";
        assert!(calls.iter().any(|call| call == foxglove), "{calls:#?}");
    }
}

/// A cargo of which these commands (patterns of the shell) end with that status, and all others well.
fn cargo_with(failing: &[(&str, i32)]) -> String {
    let arms = failing.iter().map(|(pattern, status)| format!("{pattern}) exit {status};; "));
    format!("case \"$*\" in {}esac", arms.collect::<String>())
}

fn stdout(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}

#[test]
fn deny_judges_the_packages_and_where_there_is_a_network_what_is_said_of_them() {
    let packages = "cargo deny check licenses bans sources";
    let advisories = "cargo deny check --disable-fetch advisories";
    // What fails, the status, whether advisories are judged, what is said.
    let cases = [
        (vec![], 0, true, ""),
        (vec![("'deny fetch all'", 1)], 0, false, "advisories are not judged"),
        (vec![("'deny check l'*", 1)], 1, true, ""),
        (vec![("'deny check --disable-fetch'*", 1)], 1, true, ""),
        (vec![("'deny fetch all'", 1), ("'deny check l'*", 1)], 1, false, "advisories are not judged"),
    ];
    for (failing, status, judged, wanted) in cases {
        let stage = Stage::new(&[("cargo", &cargo_with(&failing))]);
        let output = stage.xtask(&["deny"]);
        assert_eq!(output.status.code(), Some(status), "{failing:?}: {}", said(&output));
        let calls = stage.calls();
        assert!(calls.iter().any(|call| call == packages), "{failing:?}: {calls:#?}");
        assert_eq!(calls.iter().any(|call| call == advisories), judged, "{failing:?}: {calls:#?}");
        assert!(said(&output).contains(wanted), "{failing:?}: {}", said(&output));
    }
}

#[test]
fn deny_says_what_is_missing_and_its_status_tells_that_nothing_was_judged() {
    for (failing, wanted) in
        [("'deny --version'", "`cargo install cargo-deny --locked` installs it"), ("fetch*", "is there a network?")]
    {
        let stage = Stage::new(&[("cargo", &cargo_with(&[(failing, 101)]))]);
        let output = stage.xtask(&["deny"]);
        assert_eq!(output.status.code(), Some(NO_COMPILER), "{}", said(&output));
        assert!(said(&output).contains(wanted), "{}", said(&output));
        assert!(!stage.calls().iter().any(|call| call.contains("check")), "{:?}", stage.calls());
    }
}

#[test]
fn the_checks_go_on_without_cargo_deny_but_not_past_what_it_finds_and_tell_their_times() {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../.ci/run");
    let run = |failing: &[(&str, i32)]| {
        let cargo = cargo_with(failing);
        let stage = Stage::with_compiler(&[
            ("qemu-system-arm", "exit 0"),
            ("chromium", "exit 0"),
            ("rustup", "exit 0"),
            ("cargo", &cargo),
        ]);
        let output = stage.run(&script, &[]);
        (output.status.code(), stdout(&output), stage.calls())
    };
    let install = "cargo install cargo-deny --locked";
    let was_installed = |calls: &[String]| calls.iter().any(|call| call == install);

    // There already.
    let (status, told, calls) = run(&[]);
    assert!(status == Some(0) && !was_installed(&calls), "{told}\n{calls:#?}");
    for stage in [
        "lints and documentation",
        "licences and sources",
        "the images of a release",
        "the tests",
        "the image's size and speed",
    ] {
        let timed = told
            .lines()
            .filter(|line| line.strip_prefix(stage).is_some_and(|rest| rest.starts_with(": ") && rest.ends_with(" s")));
        assert_eq!(timed.count(), 1, "{stage}: {told}");
    }
    // To be had from the network.
    let (status, _, calls) = run(&[("'deny --version'", 101)]);
    assert!(status == Some(0) && was_installed(&calls), "{calls:#?}");
    // Not to be had.
    let (status, told, calls) = run(&[("'deny --version'|install*", 101), ("'xtask deny'", NO_COMPILER)]);
    assert!(status == Some(0) && calls.iter().any(|call| call == "cargo test"), "{told}\n{calls:#?}");
    assert!(told.contains("SKIPPED: licences, bans, sources and advisories"), "{told}");
    assert!(told.contains("\nlicences and sources (skipped): "), "{told}");
    // It found something.
    let (status, told, calls) = run(&[("'xtask deny'", 1)]);
    assert!(status == Some(1) && !calls.iter().any(|call| call == "cargo test"), "{told}\n{calls:#?}");
    assert!(told.contains("FAILED in: licences and sources"), "{told}");
}
