//! Forces and places as messages in MCAP files: of robots, of other tools, of this one.
//!
//! Forces are `geometry_msgs/msg/WrenchStamped` or `Wrench`, places `PoseStamped`, `PoseWithCovarianceStamped`, `TransformStamped` or
//! `PointStamped`, as ROS 2 has them on the wire (CDR). Times are those of the headers, s since 1970, and where a header has none
//! those of the file.
//!
//! Frames: as in the file; a [`Mapping`] names other fields (`fx=-force.z`) and units. Units: SI.
//! Errors: [`StampedError`] for a file that gives nothing; what of it could not be read is told beside.

use std::collections::BTreeMap;
use std::path::Path;

use nalgebra::{Point2, Vector2};
use palpate::finger::contact::Reading;

use super::mapping::{Mapping, Place};
use super::table::Quantity;
use crate::mcap::cdr::CdrFields;
use crate::mcap::{Channel, Content, McapError, Reader};

/// Why a file gives nothing.
#[derive(Debug, thiserror::Error)]
pub enum StampedError {
    /// Not a file that can be read.
    #[error(transparent)]
    Mcap(#[from] McapError),
    /// No channel has such messages.
    #[error("it has no {wanted}; its topics are {found}")]
    None {
        /// What is sought.
        wanted: &'static str,
        /// Topics with their types.
        found: String,
    },
    /// Several channels have such messages.
    #[error("several of its topics have {wanted}: {found}")]
    Several {
        /// What is sought.
        wanted: &'static str,
        /// The topics.
        found: String,
    },
    /// The topic that was named is not there, or has other messages.
    #[error("its topic {topic} has no {wanted}; its topics are {found}")]
    Other {
        /// What is sought.
        wanted: &'static str,
        /// The topic.
        topic: String,
        /// Topics with their types.
        found: String,
    },
    /// A field is told that such messages do not have.
    #[error("{wanted} have no field {field}; their fields are {fields}")]
    Field {
        /// What is sought.
        wanted: &'static str,
        /// As the mapping says.
        field: String,
        /// What there is.
        fields: String,
    },
    /// A unit is told that is not known.
    #[error("`{unit}` is not a unit of {quantity} known here (known: {known})")]
    Unit {
        /// As the mapping says.
        unit: String,
        /// What it is to be a unit of.
        quantity: &'static str,
        /// What would be understood.
        known: &'static str,
    },
    /// The channel is there, and has not one message that could be read.
    #[error("{topic} has no message that can be read ({bad} cannot)")]
    Empty {
        /// The topic.
        topic: String,
        /// Messages that are not as their type says.
        bad: usize,
    },
}

/// What a file gave.
#[derive(Debug)]
pub struct Stamped<T> {
    /// With increasing times.
    pub rows: Vec<T>,
    /// The topic that they are from.
    pub topic: String,
    /// The unit of forces where the file names one, as this tool's recordings do; otherwise ROS has newtons.
    pub unit: Option<String>,
    /// What could not be read, or was left out: a sentence each.
    pub problems: Vec<String>,
}

/// What messages of a kind hold.
struct Kind {
    wanted: &'static str,
    /// Types that are known, without package and `msg`, whether they have a header, and where else a text stands before the numbers.
    types: &'static [(&'static str, Layout)],
    /// The numbers in such a message, in order.
    fields: &'static [&'static str],
    keys: [&'static str; 2],
    usual: [&'static str; 2],
    quantity: Quantity,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Layout {
    Bare,
    Headed,
    /// A header and the name of another frame.
    Framed,
}

const FORCES: Kind = Kind {
    wanted: "forces (geometry_msgs/msg/WrenchStamped)",
    types: &[("WrenchStamped", Layout::Headed), ("Wrench", Layout::Bare)],
    fields: &["force.x", "force.y", "force.z", "torque.x", "torque.y", "torque.z"],
    keys: ["fx", "fy"],
    usual: ["force.x", "force.y"],
    quantity: Quantity::FORCE,
};

const PLACES: Kind = Kind {
    wanted: "places (geometry_msgs/msg/PoseStamped)",
    types: &[
        ("PoseStamped", Layout::Headed),
        ("PoseWithCovarianceStamped", Layout::Headed),
        ("PointStamped", Layout::Headed),
        ("TransformStamped", Layout::Framed),
    ],
    fields: &["position.x", "position.y", "position.z"],
    keys: ["x", "y"],
    usual: ["position.x", "position.y"],
    quantity: Quantity::LENGTH,
};

/// The channel that is taken where a recording of this tool has several.
const OWN_FORCES: &str = "/finger/wrench";

/// Whether a file begins as MCAP files do.
#[must_use]
pub fn is_mcap(path: &Path) -> bool {
    Reader::open(path).is_ok()
}

/// Reads the forces in a file.
///
/// # Errors
/// [`StampedError`].
pub fn forces(path: &Path, mapping: &Mapping) -> Result<Stamped<Reading>, StampedError> {
    let Stamped { rows, topic, unit, problems } = read(path, mapping, &FORCES)?;
    let rows = rows.into_iter().map(|[t, x, y]| Reading::new(t, Vector2::new(x, y))).collect();
    Ok(Stamped { rows, topic, unit, problems })
}

/// Reads the places in a file.
///
/// # Errors
/// [`StampedError`].
pub fn places(path: &Path, mapping: &Mapping) -> Result<Stamped<(f64, Point2<f64>)>, StampedError> {
    let Stamped { rows, topic, unit, problems } = read(path, mapping, &PLACES)?;
    let rows = rows.into_iter().map(|[t, x, y]| (t, Point2::new(x, y))).collect();
    Ok(Stamped { rows, topic, unit, problems })
}

impl Kind {
    /// How messages of this channel are laid out, if they are of this kind.
    fn layout(&self, channel: &Channel) -> Option<Layout> {
        let is_ros = channel.message_encoding == "cdr" && channel.schema_name.starts_with("geometry_msgs/");
        let name = channel.schema_name.rsplit('/').next().filter(|_| is_ros)?;
        self.types.iter().find(|(known, _)| *known == name).map(|(_, layout)| *layout)
    }

    /// Which numbers of a message are wanted, and what to multiply them by.
    fn chosen(&self, mapping: &Mapping) -> Result<[(usize, f64); 2], StampedError> {
        let mut chosen = [(0, 1.0); 2];
        for (axis, chosen) in chosen.iter_mut().enumerate() {
            let source = mapping.source(self.keys[axis]);
            let name = match source.map(|source| &source.place) {
                Some(Place::Name(name)) => name.as_str(),
                Some(Place::Number(number)) => return Err(self.no_field(&format!("#{number}"))),
                None => self.usual[axis],
            };
            let named = |field: &&&str| name == **field || name.ends_with(&format!(".{field}"));
            let field = self.fields.iter().position(|field| named(&field)).ok_or_else(|| self.no_field(name))?;
            let unit = source.and_then(|source| source.unit.as_deref());
            let scale = unit.map_or(Ok(1.0), |unit| {
                let (quantity, known) = self.quantity.told();
                let unknown = || StampedError::Unit { unit: unit.to_owned(), quantity, known };
                self.quantity.in_si(unit).ok_or_else(unknown)
            })?;
            *chosen = (field, if source.is_some_and(|source| source.is_negative) { -scale } else { scale });
        }
        Ok(chosen)
    }

    fn no_field(&self, field: &str) -> StampedError {
        StampedError::Field { wanted: self.wanted, field: field.to_owned(), fields: self.fields.join(", ") }
    }
}

/// A message's time, if its header has one, and its numbers.
fn numbers(message: &[u8], layout: Layout, count: usize) -> Option<(u64, Vec<f64>)> {
    let mut fields = CdrFields::of(message)?;
    let stamp = if layout == Layout::Bare { 0 } else { fields.header()?.0 };
    if layout == Layout::Framed {
        fields.text()?;
    }
    let numbers = (0..count).map(|_| fields.f64()).collect::<Option<Vec<_>>>()?;
    Some((stamp, numbers))
}

/// When, in ns since 1970, and the two numbers chosen.
type StampedRow = (u64, [f64; 2]);

fn read(path: &Path, mapping: &Mapping, kind: &Kind) -> Result<Stamped<[f64; 3]>, StampedError> {
    let chosen = kind.chosen(mapping)?;
    let mut reader = Reader::open(path)?;
    // Times in ns: as s since 1970 they would be rounded before they are compared.
    let mut by_channel: BTreeMap<u16, (Vec<StampedRow>, usize)> = BTreeMap::new();
    let mut problems = Vec::new();
    loop {
        match reader.next_content() {
            Ok(Some(Content::Message { channel, log_time_ns, data, .. })) => {
                let (rows, bad) = by_channel.entry(channel).or_default();
                let Some(layout) = reader.channel(channel).and_then(|channel| kind.layout(channel)) else { continue };
                match numbers(&data, layout, kind.fields.len()) {
                    Some((stamp, numbers)) if numbers.iter().all(|number| number.is_finite()) => {
                        let at = if stamp == 0 { log_time_ns } else { stamp };
                        rows.push((at, chosen.map(|(field, scale)| numbers[field] * scale)));
                    }
                    _ => *bad += 1,
                }
            }
            Ok(Some(_)) => {}
            Ok(None) => break,
            Err(error) if by_channel.is_empty() => return Err(error.into()),
            Err(error) => {
                problems.push(format!("{error}; what comes before was read"));
                break;
            }
        }
    }
    let channel = chosen_channel(&reader, by_channel.keys().copied(), mapping, kind)?;
    let told = reader.channel(channel);
    let topic = told.map(|channel| channel.topic.clone()).unwrap_or_default();
    let unit = told.and_then(|channel| channel.metadata.get("unit_of_force").cloned());
    // A topic may have a channel for each of its senders.
    let is_topics =
        |id: u16| reader.channel(id).is_some_and(|channel| channel.topic == topic && kind.layout(channel).is_some());
    let (mut rows, mut bad) = (Vec::new(), 0);
    for (id, (own, own_bad)) in by_channel {
        if is_topics(id) {
            rows.extend(own);
            bad += own_bad;
        }
    }
    let read = rows.len();
    // Messages of one sender may be recorded in another order than they were made.
    rows.sort_by_key(|(at, _)| *at);
    rows.dedup_by_key(|(at, _)| *at);
    if rows.is_empty() {
        return Err(StampedError::Empty { topic, bad });
    }
    if bad > 0 {
        problems
            .push(format!("{topic}: {bad} messages are not as their type says, or have numbers that are not finite"));
    }
    if rows.len() < read {
        problems.push(format!("{topic}: {} messages have the time of another and are left out", read - rows.len()));
    }
    let rows = rows.into_iter().map(|(at, [x, y])| [at as f64 * 1e-9, x, y]).collect();
    Ok(Stamped { rows, topic, unit, problems })
}

/// A channel of the one topic that is wanted.
fn chosen_channel<R: std::io::Read>(
    reader: &Reader<R>,
    with_messages: impl Iterator<Item = u16>,
    mapping: &Mapping,
    kind: &Kind,
) -> Result<u16, StampedError> {
    let channels: Vec<_> = with_messages.filter_map(|id| Some((id, reader.channel(id)?))).collect();
    let found = || {
        let told = channels.iter().map(|(_, channel)| format!("{} ({})", channel.topic, channel.schema_name));
        let told = told.collect::<Vec<_>>().join(", ");
        if told.is_empty() { "none".to_owned() } else { told }
    };
    let fits: Vec<_> = channels.iter().filter(|(_, channel)| kind.layout(channel).is_some()).collect();
    let wanted = kind.wanted;
    let named: Vec<_> = fits.iter().filter(|(_, channel)| mapping.topics.contains(&channel.topic)).collect();
    if let [(id, _), ..] = named[..] {
        return Ok(*id);
    }
    // Topics may be named for forces and places: one that is neither is a mistake.
    let strange = mapping.topics.iter().find(|topic| {
        !channels.iter().any(|(_, channel)| {
            channel.topic == **topic && [&FORCES, &PLACES].iter().any(|kind| kind.layout(channel).is_some())
        })
    });
    if let Some(topic) = strange {
        return Err(StampedError::Other { wanted, topic: topic.clone(), found: found() });
    }
    let mut topics: Vec<_> = fits.iter().map(|(_, channel)| channel.topic.as_str()).collect();
    topics.sort_unstable();
    topics.dedup();
    match (&fits[..], &topics[..]) {
        ([], _) => Err(StampedError::None { wanted, found: found() }),
        ([(id, _), ..], [_]) => Ok(*id),
        _ => {
            let own = fits.iter().find(|(_, channel)| channel.topic == OWN_FORCES);
            own.map(|(id, _)| *id).ok_or_else(|| StampedError::Several { wanted, found: topics.join(", ") })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mcap::cdr::Cdr;
    use crate::mcap::{Channel, Writer};

    /// A file of these messages: topic, type, time, numbers.
    fn file(folder: &Path, messages: &[(&str, &str, u64, &[f64])]) -> std::path::PathBuf {
        let path = folder.join(format!("{}.mcap", std::fs::read_dir(folder).unwrap().count()));
        let mut writer = Writer::create(&path, "another tool").unwrap();
        for (number, (topic, kind, at, numbers)) in (0_u64..).zip(messages) {
            let channel = Channel {
                topic: (*topic).to_owned(),
                message_encoding: "cdr".to_owned(),
                schema_name: (*kind).to_owned(),
                schema_encoding: "ros2msg".to_owned(),
                schema: String::new(),
                metadata: BTreeMap::new(),
            };
            let id = writer.channel(&channel);
            let message = Cdr::new().header(*at, "tool").f64s(numbers.iter().copied()).finish();
            writer.message(id, number, number, &message);
        }
        writer.flush().unwrap();
        path
    }

    const WRENCH: &str = "geometry_msgs/msg/WrenchStamped";
    const POSE: &str = "geometry_msgs/msg/PoseStamped";

    #[test]
    fn forces_and_places_of_others_are_read_in_the_order_of_their_times() {
        let folder = tempfile::tempdir().unwrap();
        let path = file(
            folder.path(),
            &[
                ("/ft", WRENCH, 2_000_000_000, &[3.0, 4.0, 0.0, 0.0, 0.0, 0.0]),
                ("/tool", POSE, 1_500_000_000, &[0.1, 0.2, 0.3, 0.0, 0.0, 0.0, 1.0]),
                ("/ft", WRENCH, 1_000_000_000, &[1.0, 2.0, 9.0, 0.0, 0.0, 0.0]),
                ("/ft", WRENCH, 3_000_000_000, &[f64::NAN, 2.0, 0.0, 0.0, 0.0, 0.0]),
            ],
        );
        let read = forces(&path, &Mapping::default()).unwrap();
        let rows =
            |rows: Vec<Reading>| rows.iter().map(|r| [r.t, r.force_finger.x, r.force_finger.y]).collect::<Vec<_>>();
        assert_eq!(rows(read.rows), [[1.0, 1.0, 2.0], [2.0, 3.0, 4.0]]);
        assert!(read.problems.len() == 1 && read.problems[0].starts_with("/ft: 1 messages"), "{:?}", read.problems);
        assert_eq!(places(&path, &Mapping::default()).unwrap().rows, [(1.5, Point2::new(0.1, 0.2))]);
        let turned = forces(&path, &Mapping::parse("fx=-force.y[mN],fy=wrench.force.z").unwrap()).unwrap();
        assert_eq!(rows(turned.rows).first(), Some(&[1.0, -0.002, 9.0]));
    }

    #[test]
    fn what_is_not_there_or_ambiguous_is_told_with_what_there_is() {
        let folder = tempfile::tempdir().unwrap();
        let zero = &[0.0; 6][..];
        let path = file(folder.path(), &[("/a", WRENCH, 1, zero), ("/b", WRENCH, 1, &[1.0; 6])]);
        let told = |mapping: &Mapping| forces(&path, mapping).unwrap_err().to_string();
        assert!(
            told(&Mapping::default()).contains("several of its topics have forces"),
            "{}",
            told(&Mapping::default())
        );
        let topic = |name: &str| Mapping { topics: vec![name.to_owned()], ..Mapping::default() };
        assert_eq!(forces(&path, &topic("/b")).unwrap().rows[0].force_finger, Vector2::new(1.0, 1.0));
        assert!(told(&topic("/c")).contains("its topic /c has no forces"), "{}", told(&topic("/c")));
        assert!(told(&Mapping::parse("fx=force.w").unwrap()).contains("no field force.w"));
        let none = places(&path, &Mapping::default()).unwrap_err().to_string();
        assert!(none.contains("/a (geometry_msgs/msg/WrenchStamped), /b"), "{none}");
    }

    #[test]
    fn of_this_tools_recordings_the_tared_forces_are_taken() {
        let folder = tempfile::tempdir().unwrap();
        let raw = ("/finger/wrench_raw", WRENCH, 1, &[5.0; 6][..]);
        let path = file(folder.path(), &[raw, (OWN_FORCES, WRENCH, 1, &[1.0; 6])]);
        assert_eq!(forces(&path, &Mapping::default()).unwrap().topic, OWN_FORCES);
    }
}
