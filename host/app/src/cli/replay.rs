//! `palpate replay`.

use std::ffi::OsString;
use std::fs;
use std::path::{Component, Path, PathBuf};
use std::process::ExitCode;

use miette::{IntoDiagnostic as _, WrapErr as _};

use super::read::DRAWING;
use crate::recording::play::{self, Attached};

/// Runs the command of a recording again, on what was recorded.
///
/// It prints what it printed, line by line; with another command after `--`, what that makes of the same samples. Files
/// that the command read are taken from the recording where they are gone or have changed.
///
/// Exit status: that of the command; 1 if the recording cannot be used, 64 wrong command line.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// The recording
    #[arg(value_name = "RUN.mcap")]
    run: PathBuf,

    /// So many times as fast as it was recorded [default: as fast as it is read]
    #[arg(long, value_name = "TIMES", value_parser = super::positive)]
    speed: Option<f64>,

    /// Another command than the recorded one, such as `monitor --json`
    #[arg(last = true, value_name = "COMMAND")]
    command: Vec<String>,
}

/// Options of the recorded command that are left out, with their values: the device is the recording, its calibration comes
/// with it, and files that were written stay as they are.
const LEFT_OUT: [&str; 9] =
    ["-d", "--device", "--baud", "--speed", "--record", "--keep-tare", "-c", "--calibration", "--plot"];

pub(crate) fn run(arguments: &Arguments) -> miette::Result<ExitCode> {
    let recorded = play::run_of(&arguments.run)?;
    let is_recorded = arguments.command.is_empty();
    let words = if is_recorded {
        recorded.command_line.get(1..).unwrap_or_default().to_vec()
    } else {
        arguments.command.clone()
    };
    let mut words = without_device(&words);
    if words.first().is_none_or(|command| command == "record") {
        return Err(miette::miette!(
            help = format!("name one, for example: palpate replay {} -- monitor", arguments.run.display()),
            "the recording is of `palpate record`, which prints nothing to play again"
        ));
    }
    let folder = tempfile::tempdir().into_diagnostic().wrap_err("cannot keep the recording's files meanwhile")?;
    let drawings: Vec<_> = recorded.attached.iter().filter(|attached| attached.role == DRAWING).collect();
    for attached in recorded.attached.iter().filter(|_| is_recorded) {
        // A file that names others goes with them.
        let beside = || drawings.iter().filter_map(|drawing| Some((*drawing, path_beside(drawing, attached)?)));
        if words.contains(&attached.name)
            && (has_changed(attached) || beside().any(|(drawing, _)| has_changed(drawing)))
        {
            let kept = kept(folder.path(), attached)?;
            for (drawing, path) in beside() {
                keep(&folder.path().join(path), drawing)?;
            }
            words.iter_mut().filter(|word| **word == attached.name).for_each(|word| word.clone_from(&kept));
            note!("{} is gone or has changed: the recording's is taken", attached.name);
        }
    }
    let device = ["-d".to_owned(), format!("file:{}", arguments.run.display())];
    let speed = arguments.speed.map(|speed| ["--speed".to_owned(), speed.to_string()]);
    let rest = device.into_iter().chain(speed.into_iter().flatten());
    let words = ["palpate".to_owned()].into_iter().chain(words).chain(rest);
    Ok(super::run(words.map(OsString::from)))
}

/// The words of a command without [`LEFT_OUT`] and `--full`, which go with a device and a recording of its own.
fn without_device(words: &[String]) -> Vec<String> {
    without(words, &LEFT_OUT, &["--full"])
}

/// The words of a command without these options, which have values, and these, which have none.
pub(super) fn without(words: &[String], options: &[&str], flags: &[&str]) -> Vec<String> {
    let mut kept = Vec::new();
    let mut words = words.iter();
    while let Some(word) = words.next() {
        let is_short = |option: &&str| !option.starts_with("--") && word.starts_with(*option);
        let with_value = |option: &&str| word.starts_with(&format!("{option}="));
        if options.contains(&word.as_str()) {
            words.next();
        } else if !flags.contains(&word.as_str())
            && !options.iter().any(|option| is_short(option) || with_value(option))
        {
            kept.push(word.clone());
        }
    }
    kept
}

/// Whether the file is not what it was when it was recorded.
fn has_changed(attached: &Attached) -> bool {
    fs::read(&attached.name).map_or(true, |now| now != attached.data)
}

/// The file, written where nothing else is.
fn kept(folder: &Path, attached: &Attached) -> miette::Result<String> {
    let name = Path::new(&attached.name).file_name().unwrap_or_default();
    let path = folder.join(name);
    keep(&path, attached)?;
    Ok(path.display().to_string())
}

fn keep(path: &Path, attached: &Attached) -> miette::Result<()> {
    let folder = path.parent().map_or(Ok(()), fs::create_dir_all);
    let kept = folder.and_then(|()| fs::write(path, &attached.data));
    kept.into_diagnostic().wrap_err("cannot keep the recording's files meanwhile")
}

/// The path of a drawing from the folder of the file that names it, if it is in there.
fn path_beside(drawing: &Attached, file: &Attached) -> Option<PathBuf> {
    let folder = Path::new(&file.name).parent()?;
    let path = Path::new(&drawing.name).strip_prefix(folder).ok()?;
    path.components().all(|part| matches!(part, Component::Normal(_))).then(|| path.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_recorded_commands_device_is_left_out_however_it_was_written() {
        let words = |line: &str| line.split(' ').map(str::to_owned).collect::<Vec<_>>();
        for line in [
            "monitor -d /dev/ttyACM0 --json --record a.mcap --full",
            "monitor --device=/dev/ttyACM0 --json --record=a.mcap",
            "monitor --json -d/dev/ttyACM0 --keep-tare t.toml -c f.toml --baud 115200",
        ] {
            assert_eq!(without_device(&words(line)), words("monitor --json"), "{line}");
        }
    }
}
