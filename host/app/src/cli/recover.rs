//! `palpate recover`.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use miette::{IntoDiagnostic as _, WrapErr as _};
use palpate_files::mcap::{Channel, ChannelId, Content, Damage, Recovered, Recovery, Writer};

/// Exit status where something is lost.
const EXIT_LOSS: u8 = 3;

/// Brings back what a damaged recording still has, in a new file.
///
/// Every chunk and attached file whose checksum fits comes back, before the damage and behind it; what is lost is told.
///
/// Exit status: 0 where nothing is missing, 3 where something is, 1 where nothing can be had, 64 wrong command line.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// The damaged recording, or any other MCAP file with LZ4
    #[arg(value_name = "RUN.mcap")]
    run: PathBuf,

    /// The new file, which must not exist [default: RUN.recovered.mcap]
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

pub(crate) fn run(arguments: &Arguments) -> miette::Result<ExitCode> {
    let path = &arguments.run;
    let cannot = || format!("cannot recover {}", path.display());
    let file = fs::read(path).into_diagnostic().wrap_err_with(cannot)?;
    let recovery = Recovery::of(&file);
    if recovery.found.is_empty() {
        let help = "is it a recording? MCAP files begin with \\x89MCAP0";
        let bytes = file.len();
        return Err(miette::miette!(help = help, "no part of its {bytes} bytes is whole").wrap_err(cannot()));
    }
    let out = arguments.out.clone().unwrap_or_else(|| path.with_extension("recovered.mcap"));
    let size = write(&recovery, &out).wrap_err_with(|| format!("cannot write {}", out.display()))?;
    let messages = recovery.messages().count();
    say!("{messages} messages in {}, {:.2} MB", out.display(), size as f64 * 1e-6);
    let first_ns = recovery.messages().map(|message| message.log_time_ns).min();
    recovery.damages.iter().for_each(|damage| say!("{}", in_words(damage, first_ns)));
    for (topic, lost) in recovery.missing() {
        say!("lost: {lost} messages of {topic} between those that are there");
    }
    Ok(if recovery.is_whole() { ExitCode::SUCCESS } else { ExitCode::from(EXIT_LOSS) })
}

/// Where the file is damaged, with times since the first message.
fn in_words(damage: &Damage, first_ns: Option<u64>) -> String {
    let Damage { bytes, between_ns } = damage;
    let since = |ns: Option<u64>| Some(ns?.saturating_sub(first_ns?) as f64 * 1e-9);
    let when = match (since(between_ns.0), since(between_ns.1)) {
        (Some(from), Some(to)) => format!(", between {from:.3} s and {to:.3} s"),
        (Some(from), None) => format!(", after {from:.3} s"),
        (None, Some(_)) => ", before the first message".to_owned(),
        (None, None) => String::new(),
    };
    match bytes.is_empty() {
        true => format!("the end is missing{when}"),
        false => format!("damaged: bytes {} to {}{when}", bytes.start, bytes.end),
    }
}

/// Writes what came back, chunk by chunk; the size in bytes.
fn write(recovery: &Recovery, out: &Path) -> miette::Result<u64> {
    let mut writer =
        Writer::create(out, concat!("palpate ", env!("CARGO_PKG_VERSION"))).map_err(|error| match error.kind() {
            std::io::ErrorKind::AlreadyExists => {
                miette::miette!(help = "name another with --out", "it exists already and is never overwritten")
            }
            _ => miette::miette!("{error}"),
        })?;
    let mut channels: Vec<(&Channel, ChannelId)> = Vec::new();
    let (mut last_ns, mut size) = (0, 0);
    for found in &recovery.found {
        match found {
            Recovered::Beside(Content::Attachment { name, media_type, data }) => {
                writer.attachment(name, media_type, data, last_ns);
            }
            Recovered::Beside(Content::Metadata { name, texts }) => writer.metadata(name, texts),
            Recovered::Beside(Content::Message { .. }) => {}
            Recovered::Chunk(messages) => {
                for message in messages {
                    let known = channels.iter().find(|(channel, _)| **channel == message.channel);
                    let id = known.map_or_else(|| writer.channel(&message.channel), |(_, id)| *id);
                    if known.is_none() {
                        channels.push((&message.channel, id));
                    }
                    last_ns = message.log_time_ns;
                    writer.message(id, last_ns, message.publish_time_ns, &message.data);
                }
                size = writer.flush().into_diagnostic()?;
            }
        }
    }
    Ok(size.max(writer.flush().into_diagnostic()?))
}
