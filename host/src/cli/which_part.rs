//! `palpate which-part`.

use std::path::PathBuf;
use std::process::ExitCode;

use palpate::observing::PartEstimate;
use palpate::observing::from_rest::{self, Estimate};
use palpate::part_file::PolygonFile;
use serde_json::json;

use super::felt_push::FeltPushArguments;
use super::pose;
use super::read::read;

/// Names which of several known parts a finger has begun to push, and where it is.
///
/// Takes the files of `palpate observe` and several part files. Every part is as likely beforehand. Exit status: 0, also where no part
/// explains the force; 1 if something cannot be used, 64 wrong command line.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// A part file; once for each part that it may be
    #[arg(long = "part", value_name = "PART.toml", required = true)]
    parts: Vec<PathBuf>,

    #[command(flatten)]
    push: FeltPushArguments,

    /// Print one JSON object: SI units, radians
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(arguments: &Arguments) -> miette::Result<ExitCode> {
    let files = arguments.parts.iter().map(|path| read(path, PolygonFile::parse)).collect::<Result<Vec<_>, _>>()?;
    let push = arguments.push.read()?;
    let known: Vec<_> = files.iter().map(|file| push.known(file)).collect();
    let ranked = from_rest::which_part(&known, &push.force);
    if arguments.json {
        let parts: Vec<_> = ranked.iter().map(|part| arguments.as_json(part)).collect();
        say!("{}", json!({ "parts": parts }));
        return Ok(ExitCode::SUCCESS);
    }
    for part in &ranked {
        say!("{:6.3}  {}", part.probability, arguments.parts[part.part].display());
    }
    match ranked.first().filter(|first| first.probability > 0.0) {
        Some(first) => {
            let part = &files[first.part].part;
            say!("\nIf it is {}:\n{}", arguments.parts[first.part].display(), pose::headings(&first.estimate));
            pose::lines(part, &first.estimate).iter().for_each(|line| say!("{line}"));
            say!("{}", pose::in_words(part, &first.estimate));
        }
        None => say!("None of these parts explains what was felt."),
    }
    Ok(ExitCode::SUCCESS)
}

impl Arguments {
    fn as_json(&self, part: &PartEstimate<Estimate>) -> serde_json::Value {
        json!({
            "part": self.parts[part.part].display().to_string(),
            "probability": part.probability,
            "estimate": pose::as_json(&part.estimate),
        })
    }
}
