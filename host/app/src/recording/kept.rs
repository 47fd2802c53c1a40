//! What was made of a run, read back to be looked at: forces, contacts, poses, what was counted and told.
//!
//! A recording is read as far as it is whole. Of other tools' files what has our topics is found.
//!
//! Frames as in `derived`. Units: SI, times in ns since 1970; forces in the recording's unit.

use std::collections::BTreeMap;
use std::path::Path;

use nalgebra::{Matrix3, Vector2};
use palpate::geometry::Pose;
use palpate_files::mcap::cdr::CdrFields;
use palpate_files::mcap::{Channel, Content, McapError, Reader};
use serde::Deserialize;

use super::channels::Kind;
use super::derived::Believed;
use super::play::Attached;
use super::{ATTACHED, RUN};

/// What was made of a run.
#[derive(Debug, Default)]
pub(crate) struct Kept {
    /// What was run: `command_line`, `version`, `folder`, `system`; empty where the file is another tool's.
    pub(crate) run: BTreeMap<String, String>,
    /// Channels with their messages.
    pub(crate) channels: BTreeMap<String, Topic>,
    /// Files that came with it, with their SHA-256 as recorded.
    pub(crate) attached: Vec<(Attached, String)>,
    /// Symbol of the unit of force.
    pub(crate) unit_of_force: String,
    /// Forces as calibrated, tare included.
    pub(crate) raw: Vec<(u64, Vector2<f64>)>,
    /// Forces less the tare.
    pub(crate) tared: Vec<(u64, Vector2<f64>)>,
    pub(crate) contacts: Vec<(u64, KeptContact)>,
    pub(crate) beliefs: Vec<(u64, Belief)>,
    pub(crate) counters: Vec<(u64, Counters)>,
    /// What the person was told.
    pub(crate) log: Vec<(u64, String)>,
    /// What came in beside the link: its source, and a line or its end.
    pub(crate) inputs: Vec<(u64, Input)>,
    /// The first and the last message.
    pub(crate) span: Option<(u64, u64)>,
    /// Where reading ended before the end.
    pub(crate) damage: Option<String>,
}

/// A channel as a report names it.
#[derive(Debug, Default)]
pub(crate) struct Topic {
    pub(crate) schema: String,
    pub(crate) messages: usize,
}

/// What the finger touched at a moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct KeptContact {
    pub(crate) is_measured: bool,
    pub(crate) is_touching: bool,
    /// Polar angle of the contact and its standard deviation, rad; NaN without one.
    pub(crate) u: f64,
    pub(crate) u_sd: f64,
    pub(crate) force: Vector2<f64>,
}

/// Where the part may have been.
#[derive(Debug)]
pub(crate) struct Belief {
    /// Up to when the push was used, s since it began; NaN of slow ones.
    pub(crate) felt_s: f64,
    /// Number of the part.
    pub(crate) part: u32,
    /// The likeliest first.
    pub(crate) hypotheses: Vec<Believed>,
}

/// What was counted up to a moment.
#[derive(Clone, Copy, Debug, Default, Deserialize)]
#[serde(default)]
pub(crate) struct Counters {
    pub(crate) samples: u64,
    pub(crate) missing: u64,
    pub(crate) damaged_frames: u64,
    pub(crate) disconnections: u64,
    pub(crate) restarts: u64,
    pub(crate) temperature_c: Option<f64>,
}

/// What came in beside the link.
#[derive(Debug, Deserialize)]
pub(crate) struct Input {
    pub(crate) source: String,
    pub(crate) line: Option<String>,
}

impl Kept {
    /// Reads a recording as far as it is whole.
    pub(crate) fn read(path: &Path) -> Result<Self, McapError> {
        let mut reader = Reader::open(path)?;
        let (mut kept, mut facts) = (Self::default(), BTreeMap::new());
        loop {
            match reader.next_content() {
                Ok(Some(Content::Message { channel, log_time_ns, data, .. })) => {
                    if let Some(channel) = reader.channel(channel) {
                        kept.take(channel, log_time_ns, &data);
                    }
                }
                Ok(Some(Content::Metadata { name, texts })) if name == RUN => kept.run = texts,
                Ok(Some(Content::Metadata { name, texts })) if name == ATTACHED => facts = texts,
                Ok(Some(Content::Metadata { .. })) => {}
                Ok(Some(Content::Attachment { name, data, .. })) => {
                    let fact = |key: &str| facts.get(key).cloned().unwrap_or_default();
                    let (role, sha256) = (fact("role"), fact("sha256"));
                    kept.attached.push((Attached { role, name, data }, sha256));
                }
                Ok(None) => return Ok(kept),
                Err(error) => {
                    kept.damage = Some(error.to_string());
                    return Ok(kept);
                }
            }
        }
    }

    fn take(&mut self, channel: &Channel, at: u64, data: &[u8]) {
        let topic = self.channels.entry(channel.topic.clone()).or_default();
        topic.messages += 1;
        if topic.schema.is_empty() {
            topic.schema.clone_from(&channel.schema_name);
        }
        let (first, last) = self.span.unwrap_or((at, at));
        self.span = Some((first.min(at), last.max(at)));
        if let Some(unit) = channel.metadata.get("unit_of_force") {
            self.unit_of_force.clone_from(unit);
        }
        // What is not as it should be is left out, as damage of one message is.
        let is = |kind: Kind| channel.topic == kind.topic();
        match () {
            () if is(Kind::WrenchRaw) => self.raw.extend(wrench(data).map(|force| (at, force))),
            () if is(Kind::Wrench) => self.tared.extend(wrench(data).map(|force| (at, force))),
            () if is(Kind::Contact) => self.contacts.extend(contact(data).map(|contact| (at, contact))),
            () if is(Kind::Belief) => self.beliefs.extend(belief(data).map(|belief| (at, belief))),
            () if is(Kind::Log) => self.log.extend(told(data).map(|text| (at, text))),
            () if is(Kind::Counters) => self.counters.extend(serde_json::from_slice(data).ok().map(|it| (at, it))),
            () if is(Kind::Inputs) => self.inputs.extend(serde_json::from_slice(data).ok().map(|it| (at, it))),
            () => {}
        }
    }

    /// The words of the command that was run.
    pub(crate) fn command_line(&self) -> Vec<String> {
        self.run.get("command_line").and_then(|words| serde_json::from_str(words).ok()).unwrap_or_default()
    }

    /// The newest file of this role that came with it.
    pub(crate) fn attachment(&self, role: &str) -> Option<&Attached> {
        self.attached.iter().rev().map(|(attached, _)| attached).find(|attached| attached.role == role)
    }
}

fn wrench(data: &[u8]) -> Option<Vector2<f64>> {
    let mut fields = CdrFields::of(data)?;
    fields.header()?;
    fields.f64s().map(|[x, y]| Vector2::new(x, y))
}

fn contact(data: &[u8]) -> Option<KeptContact> {
    let mut fields = CdrFields::of(data)?;
    fields.header()?;
    fields.f64()?;
    let (is_measured, is_touching) = (fields.bool()?, fields.bool()?);
    let [u, u_sd, _friction, x, y] = fields.f64s()?;
    Some(KeptContact { is_measured, is_touching, u, u_sd, force: Vector2::new(x, y) })
}

fn belief(data: &[u8]) -> Option<Belief> {
    let mut fields = CdrFields::of(data)?;
    fields.header()?;
    let (felt_s, part) = (fields.f64()?, fields.u32()?);
    let count = fields.length()?;
    let mut hypotheses = Vec::new();
    for _ in 0..count {
        let (probability, edge) = (fields.f64()?, usize::try_from(fields.u32()?).ok()?);
        let [x, y, theta] = fields.f64s()?;
        let covariance = Matrix3::from_row_slice(&fields.f64s::<9>()?);
        let covariance = covariance.iter().all(|entry| entry.is_finite()).then_some(covariance);
        hypotheses.push(Believed { probability, edge, pose: Pose { x, y, theta }, covariance });
    }
    Some(Belief { felt_s, part, hypotheses })
}

fn told(data: &[u8]) -> Option<String> {
    let mut fields = CdrFields::of(data)?;
    fields.time()?;
    fields.u8()?;
    fields.text()?;
    fields.text().map(str::to_owned)
}
