//! `palpate export`.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use miette::{IntoDiagnostic as _, WrapErr as _};
use palpate_files::mcap::ros2::Definition;
use palpate_files::mcap::{Channel, Content, McapError, Reader};
use palpate_files::recordings::stamped;
use serde_json::{Map, Value, json};

use super::told_tables::TableArguments;
use crate::progress;

const LONG_HELP: &str = "\
Without a topic the forces are written, less the tare where there was one, as the table that `observe` and `contact` read:
  t [s],Fx [N],Fy [N]
With one every field of its messages is a column, named by its way, and what is in a sequence of messages has a row for each:
  t,header.stamp.sec,…,wrench.force.x,wrench.force.y,…
With --json every message is an object, of all topics unless some are named:
  {\"topic\": \"/finger/contact\", \"t\": 1764107000.004, \"message\": {…}}
Times are s since 1970, to the nanosecond. What is no number, such as the angle where nothing is touched, is an empty field,
and null in JSON. Files of other tools are read too, if their messages are ROS 2's or JSON.

Exit status: 0, 1 if the file or topic cannot be used or the output not be written, 2 if the file is damaged and what comes
before the damage was written, 64 wrong command line.";

/// Exit status where the file is damaged.
const EXIT_DAMAGED: u8 = 2;

/// Writes what is in a recording as a table (CSV) or as JSON Lines.
#[derive(Debug, clap::Args)]
#[command(after_long_help = super::help::flowing(LONG_HELP))]
pub(crate) struct Arguments {
    /// The recording, or an MCAP file of another tool
    #[arg(value_name = "RUN.mcap")]
    run: PathBuf,

    /// Topics: one for a table, any for --json
    #[arg(value_name = "TOPIC")]
    topics: Vec<String>,

    /// Write JSON Lines
    #[arg(long)]
    json: bool,

    /// Say which topics there are, with what is in them
    #[arg(long, conflicts_with_all = ["topics", "json", "out"])]
    list: bool,

    /// The new file, which must not exist [default: standard output]
    #[arg(long, short = 'o', value_name = "FILE")]
    out: Option<PathBuf>,
}

pub(crate) fn run(arguments: &Arguments) -> miette::Result<ExitCode> {
    let cannot = || format!("cannot export {}", arguments.run.display());
    if arguments.list {
        return list(&arguments.run).wrap_err_with(cannot);
    }
    if !arguments.json && arguments.topics.len() > 1 {
        let help = "name one, or add --json";
        return Err(miette::miette!(help = help, "a table is of one topic").wrap_err(cannot()));
    }
    let mut to = Output::open(arguments.out.as_deref())?;
    let ended = match (&arguments.topics[..], arguments.json) {
        ([], false) => return forces(&arguments.run, &mut to),
        (topics, true) => lines(&arguments.run, topics, &mut to),
        ([topic, ..], false) => table(&arguments.run, topic, &mut to),
    };
    let damage = ended.wrap_err_with(cannot)?;
    to.finish()?;
    Ok(damage.map_or(ExitCode::SUCCESS, |damage| {
        tracing::warn!("{}: {damage}; what comes before was written", arguments.run.display());
        ExitCode::from(EXIT_DAMAGED)
    }))
}

/// Where the lines go.
struct Output {
    to: Option<(PathBuf, BufWriter<File>)>,
    /// Not yet on standard output.
    waiting: String,
}

/// Standard output is written in pieces of so many bytes.
const PIECE: usize = 1 << 16;

impl Output {
    fn open(path: Option<&Path>) -> miette::Result<Self> {
        let open = |path: &Path| {
            let file = File::create_new(path).map_err(|error| match error.kind() {
                io::ErrorKind::AlreadyExists => {
                    miette::miette!(help = "choose another name", "it exists already and is never overwritten")
                }
                _ => miette::miette!("{error}"),
            });
            file.map(|file| (path.to_owned(), BufWriter::new(file))).wrap_err_with(|| cannot_write(path))
        };
        Ok(Self { to: path.map(open).transpose()?, waiting: String::new() })
    }

    fn line(&mut self, line: &str) -> miette::Result<()> {
        if let Some((path, file)) = &mut self.to {
            return writeln!(file, "{line}").into_diagnostic().wrap_err_with(|| cannot_write(path));
        }
        self.waiting += line;
        self.waiting.push('\n');
        if self.waiting.len() >= PIECE {
            super::write_out(format_args!("{}", self.waiting));
            self.waiting.clear();
        }
        Ok(())
    }

    fn finish(&mut self) -> miette::Result<()> {
        super::write_out(format_args!("{}", std::mem::take(&mut self.waiting)));
        let Some((path, file)) = &mut self.to else { return Ok(()) };
        let written = file.flush().and_then(|()| file.get_ref().sync_all());
        written.into_diagnostic().wrap_err_with(|| cannot_write(path))?;
        note!("written to {}", path.display());
        Ok(())
    }
}

fn cannot_write(path: &Path) -> String {
    format!("cannot write {}", path.display())
}

/// The forces, as other commands read them.
fn forces(run: &Path, to: &mut Output) -> miette::Result<ExitCode> {
    let tables = TableArguments::default();
    let table = tables.forces(run)?;
    let unit = if table.force_in_newtons { " [N]" } else { "" };
    to.line(&format!("t [s],Fx{unit},Fy{unit}"))?;
    for reading in &table.readings {
        let force = reading.force_finger;
        to.line(&format!("{},{},{}", reading.t, force.x, force.y))?;
    }
    to.finish()?;
    Ok(ExitCode::SUCCESS)
}

/// Goes through the messages of a file; the damage at which it ends, if it does.
fn each(
    run: &Path,
    mut take: impl FnMut(&Channel, u64, &[u8]) -> miette::Result<()>,
) -> miette::Result<Option<McapError>> {
    let mut reader = Reader::open(run).into_diagnostic()?;
    let mut taken = 0_u64;
    loop {
        match reader.next_content() {
            Ok(Some(Content::Message { channel, log_time_ns, data, .. })) => {
                if let Some(channel) = reader.channel(channel) {
                    take(channel, log_time_ns, &data)?;
                }
                taken += 1;
                if taken.is_multiple_of(10_000) {
                    progress::says(format!("{taken} messages"));
                }
            }
            Ok(Some(_)) => {}
            Ok(None) => return Ok(None),
            Err(error) if taken == 0 => return Err(miette::miette!("{error}")),
            Err(error) => return Ok(Some(error)),
        }
    }
}

/// How messages of a channel are read.
#[derive(Clone, Debug)]
enum Decoder {
    Json,
    Ros2(Definition),
    /// They are not.
    None,
}

impl Decoder {
    fn of(channel: &Channel) -> Self {
        match (channel.message_encoding.as_str(), channel.schema_encoding.as_str()) {
            ("json", _) => Self::Json,
            ("cdr", "ros2msg") => {
                Definition::parse(&channel.schema_name, &channel.schema).map_or(Self::None, Self::Ros2)
            }
            _ => Self::None,
        }
    }

    fn decode(&self, data: &[u8]) -> Option<Value> {
        match self {
            Self::Json => serde_json::from_slice(data).ok(),
            Self::Ros2(definition) => definition.decode(data),
            Self::None => None,
        }
    }
}

/// Decoders by topic, made once.
#[derive(Default)]
struct Decoders(Vec<(String, Decoder)>);

impl Decoders {
    fn of(&mut self, channel: &Channel) -> &Decoder {
        let known = self.0.iter().position(|(topic, _)| *topic == channel.topic);
        let place = known.unwrap_or_else(|| {
            self.0.push((channel.topic.clone(), Decoder::of(channel)));
            self.0.len() - 1
        });
        &self.0[place].1
    }
}

/// A time in s, to the nanosecond.
fn seconds(ns: u64) -> String {
    format!("{}.{:09}", ns / 1_000_000_000, ns % 1_000_000_000)
}

fn lines(run: &Path, topics: &[String], to: &mut Output) -> miette::Result<Option<McapError>> {
    let mut decoders = Decoders::default();
    let mut missing: Vec<_> = topics.to_vec();
    let damage = each(run, |channel, at, data| {
        if !topics.is_empty() && !topics.contains(&channel.topic) {
            return Ok(());
        }
        missing.retain(|topic| *topic != channel.topic);
        let Some(message) = decoders.of(channel).decode(data) else { return Ok(()) };
        let (topic, t) = (json!(channel.topic), seconds(at));
        to.line(&format!("{{\"topic\":{topic},\"t\":{t},\"message\":{message}}}"))
    })?;
    match missing.first() {
        Some(topic) => Err(no_topic(run, topic)),
        None => Ok(damage),
    }
}

fn table(run: &Path, topic: &str, to: &mut Output) -> miette::Result<Option<McapError>> {
    let mut decoders = Decoders::default();
    let mut columns: Option<Vec<String>> = None;
    let damage = each(run, |channel, at, data| {
        if channel.topic != topic {
            return Ok(());
        }
        let decoder = decoders.of(channel);
        let Some(message) = decoder.decode(data) else { return Ok(()) };
        let columns = match &mut columns {
            Some(columns) => columns,
            unknown => {
                let named = match decoder {
                    Decoder::Ros2(definition) => definition.columns(),
                    _ => message.as_object().map(|object| object.keys().cloned().collect()).unwrap_or_default(),
                };
                let heading = std::iter::once("t").chain(named.iter().map(String::as_str));
                to.line(&heading.collect::<Vec<_>>().join(","))?;
                unknown.insert(named)
            }
        };
        let rows = match decoder {
            Decoder::Ros2(definition) => definition.rows(&message),
            _ => vec![columns.iter().map(|column| message.get(column).cloned().unwrap_or_default()).collect()],
        };
        for row in rows {
            let cells = std::iter::once(seconds(at)).chain(row.iter().map(cell));
            to.line(&cells.collect::<Vec<_>>().join(","))?;
        }
        Ok(())
    })?;
    match columns {
        None => Err(no_topic(run, topic)),
        Some(_) => Ok(damage),
    }
}

/// A value as a field of a table (RFC 4180).
fn cell(value: &Value) -> String {
    match value {
        Value::Null => String::new(),
        Value::String(text) if !text.contains([',', '"', '\n', '\r']) => text.clone(),
        Value::String(text) => format!("\"{}\"", text.replace('"', "\"\"")),
        Value::Array(_) | Value::Object(_) => format!("\"{}\"", value.to_string().replace('"', "\"\"")),
        value => value.to_string(),
    }
}

/// The topics of a file: how many messages of which type.
fn topics(run: &Path) -> miette::Result<Map<String, Value>> {
    let mut topics = Map::new();
    each(run, |channel, _, _| {
        let told = topics.entry(channel.topic.clone()).or_insert_with(|| json!([0_u64, channel.schema_name]));
        told[0] = json!(told[0].as_u64().unwrap_or(0) + 1);
        Ok(())
    })?;
    Ok(topics)
}

fn no_topic(run: &Path, topic: &str) -> miette::Report {
    let known = topics(run).map(|topics| topics.keys().cloned().collect::<Vec<_>>().join(", ")).unwrap_or_default();
    let help = format!("palpate export {} --list", run.display());
    miette::miette!(help = help, "it has no messages of {topic} that can be read; its topics are {known}")
}

fn list(run: &Path) -> miette::Result<ExitCode> {
    let topics = topics(run)?;
    let width = topics.keys().map(String::len).max().unwrap_or(0);
    for (topic, told) in &topics {
        let kind = told[1].as_str().unwrap_or_default();
        say!("{topic:width$}  {:>9}  {kind}", told[0].to_string());
    }
    if stamped::forces(run, &TableArguments::default().mapping()).is_err() {
        note!("no forces that `palpate export` writes without a topic");
    }
    Ok(ExitCode::SUCCESS)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_of_a_table_are_whole_whatever_is_in_them() {
        let cells = [json!(null), json!("a"), json!("a,\"b\""), json!([1, 2]), json!(0.5)];
        assert_eq!(cells.each_ref().map(cell).join(";"), ";a;\"a,\"\"b\"\"\";\"[1,2]\";0.5");
        assert_eq!(seconds(1_000_000_007), "1.000000007");
    }
}
