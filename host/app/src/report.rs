//! A recorded run on one page: numbers, figures, what was told; whole in itself, for browsers and printers.
//!
//! Pure: text from what was kept. Frames as in the recording. Units: as each number says.

use std::fmt::Write as _;
use std::path::Path;

use nalgebra::Vector2;
use palpate_files::part::PolygonFile;

use crate::pictures::plot::Figure;
use crate::pictures::run::{self, Believed};
use crate::recording::kept::{Counters, Kept};

/// What a page of ours begins with, so that it may be written anew.
pub(crate) const BEGINS: &str = "<!doctype html>\n<!-- palpate report -->\n";

/// Lines of the log that are shown.
const LOG_MAX: usize = 200;

/// Hypotheses that are listed.
const LISTED_MAX: usize = 10;

/// A row of numbers: what, value.
type Fact = (String, String);

/// The page.
pub(crate) fn page(name: &Path, kept: &Kept) -> String {
    let title = name.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let mut page = format!(
        "{BEGINS}<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<meta name=\"viewport\" content=\"width=device-width, \
         initial-scale=1\">\n<title>{0}</title>\n<style>\n{STYLE}</style>\n</head>\n<body>\n<header><h1>{0}</h1>\n{1}</header>\n<main>\n",
        escaped(&title),
        headline(kept)
    );
    for warning in warnings(kept) {
        let _ = writeln!(page, "<p class=\"warning\">{}</p>", escaped(&warning));
    }
    section(&mut page, "The run in numbers", &table(&numbers(kept)));
    let mut figures = Figures::default();
    let clock = Clock::of(kept);
    figures.force(kept, &clock);
    figures.contact(kept, &clock);
    figures.belief(kept, &clock);
    page += &figures.html;
    if let Some(poses) = poses(kept) {
        section(&mut page, "Where the part is at the end", &poses);
    }
    if !kept.log.is_empty() {
        section(&mut page, "What was told", &log(kept, &clock));
    }
    if !kept.attached.is_empty() {
        section(&mut page, "Files that came with it", &attached(kept));
    }
    section(&mut page, "What is in the recording", &channels(kept));
    let version = env!("CARGO_PKG_VERSION");
    let _ = write!(
        page,
        "</main>\n<footer>Written by palpate {version}. Times count from the recording's first message.</footer>\n"
    );
    page + "</body>\n</html>\n"
}

/// Nothing but what a page needs: system fonts, room in print, no page broken within a figure; dark where that is wished, but for the
/// figures.
const STYLE: &str = "\
:root { color-scheme: light dark; }
body { font: 16px/1.5 system-ui, sans-serif; max-width: 62rem; margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.6rem; margin: 0; overflow-wrap: anywhere; }
h2 { font-size: 1.15rem; margin: 2rem 0 .5rem; }
code { font-size: .9em; overflow-wrap: anywhere; }
table { border-collapse: collapse; }
th, td { text-align: left; vertical-align: top; padding: .15rem 1.2rem .15rem 0; border-bottom: 1px solid #8884; }
td.number, th.number { text-align: right; font-variant-numeric: tabular-nums; }
td.wide { overflow-wrap: break-word; white-space: pre-line; }
figure { margin: 1.5rem 0; break-inside: avoid; }
figcaption { font-weight: 600; margin-bottom: .3rem; }
figure svg { width: 100%; height: auto; background: #fff; }
.warning { border-left: .3rem solid #d55e00; padding: .3rem .8rem; margin: 1rem 0; }
.scroll { overflow-x: auto; }
footer { margin: 2rem 0; font-size: .85rem; opacity: .75; }
@media print {
  :root { color-scheme: light; }
  body { font-size: 10.5pt; max-width: none; margin: 0; padding: 0; }
  h2 { break-after: avoid; }
  tr, .warning { break-inside: avoid; }
  .scroll { overflow: visible; }
  .scroll td { overflow-wrap: anywhere; }
  @page { margin: 15mm; }
}
";

fn section(page: &mut String, heading: &str, body: &str) {
    let _ = write!(page, "<section>\n<h2>{}</h2>\n{body}</section>\n", escaped(heading));
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// Times of a run.
struct Clock {
    first_ns: u64,
}

impl Clock {
    fn of(kept: &Kept) -> Self {
        Self { first_ns: kept.span.map_or(0, |(first, _)| first) }
    }

    /// s since the run began; a stamp may be a little before the first arrival.
    fn since(&self, ns: u64) -> f64 {
        (i128::from(ns) - i128::from(self.first_ns)) as f64 * 1e-9
    }
}

/// When, and by which command.
fn headline(kept: &Kept) -> String {
    let mut lines = String::new();
    if let Some((first, _)) = kept.span {
        let _ = writeln!(lines, "<p>{}</p>", escaped(&date(first / 1_000_000_000)));
    }
    let words = kept.command_line();
    if !words.is_empty() {
        let quoted = |word: &String| if word.contains(' ') { format!("\"{word}\"") } else { word.clone() };
        let line = words.iter().map(quoted).collect::<Vec<_>>().join(" ");
        let _ = writeln!(lines, "<p><code>{}</code></p>", escaped(&line));
    }
    lines
}

/// A moment as people write it.
fn date(unix_s: u64) -> String {
    format!("{} UTC", crate::cli::rfc3339(unix_s).replace('T', " ").trim_end_matches('Z'))
}

/// What whoever reads on has to know first.
fn warnings(kept: &Kept) -> Vec<String> {
    let mut warnings = Vec::new();
    if kept.run.is_empty() {
        warnings.push("This file is of another tool: only what has the names of palpate's topics is shown.".to_owned());
    }
    if let Some(damage) = &kept.damage {
        warnings.push(format!(
            "The file is damaged ({damage}); this is what comes before. palpate recover brings back the rest."
        ));
    }
    let is_simulated =
        kept.command_line().windows(2).any(|pair| pair[0].starts_with("-d") && pair[1].starts_with("sim:"))
            || kept.log.iter().any(|(_, told)| told.contains("SIMULATED"));
    if is_simulated {
        warnings.push("The device was simulated: nothing here was measured.".to_owned());
    }
    let counted = last_counters(kept);
    let mut lost = |count: u64, what: &str| {
        if count > 0 {
            warnings.push(format!("{count} {what}."));
        }
    };
    lost(counted.missing, "samples are missing");
    lost(counted.damaged_frames, "frames of the link were damaged");
    lost(counted.disconnections, "times the link was lost");
    lost(counted.restarts, "times the device started anew");
    let unmeasured = kept.contacts.iter().filter(|(_, contact)| !contact.is_measured).count() as u64;
    lost(unmeasured, "readings were no measurements (saturated, stuck, settling)");
    warnings
}

fn last_counters(kept: &Kept) -> Counters {
    kept.counters.last().map_or_else(Counters::default, |(_, counters)| *counters)
}

/// The forces that are shown: less the tare, where there was one.
fn forces(kept: &Kept) -> &[(u64, Vector2<f64>)] {
    if kept.tared.is_empty() { &kept.raw } else { &kept.tared }
}

fn unit(kept: &Kept) -> &str {
    if kept.unit_of_force.is_empty() { "N" } else { &kept.unit_of_force }
}

fn numbers(kept: &Kept) -> Vec<Fact> {
    let mut facts: Vec<Fact> = Vec::new();
    let mut fact = |what: &str, value: String| facts.push((what.to_owned(), value));
    let counted = last_counters(kept);
    let length = kept.span.map_or(0.0, |(first, last)| last.saturating_sub(first) as f64 * 1e-9);
    fact("length", format!("{length:.3} s"));
    if counted.samples > 0 {
        fact("samples", format!("{} delivered, {} missing", counted.samples, counted.missing));
    }
    let temperatures = kept.counters.iter().filter_map(|(_, counters)| counters.temperature_c);
    let range = temperatures
        .fold(None, |range: Option<(f64, f64)>, t| Some(range.map_or((t, t), |(low, high)| (low.min(t), high.max(t)))));
    if let Some((low, high)) = range {
        fact("temperature of the board", format!("{low:.1} to {high:.1} °C"));
    }
    let (shown, symbol) = (forces(kept), unit(kept));
    let clock = Clock::of(kept);
    let largest = shown.iter().max_by(|a, b| a.1.norm().total_cmp(&b.1.norm()));
    if let Some((at, force)) = largest {
        fact("largest force", format!("{:.4} {symbol} at {:.3} s", force.norm(), clock.since(*at)));
        let kind = if kept.tared.is_empty() { "as calibrated, without a tare" } else { "less the tare" };
        fact("forces", format!("{} values, {kind}", shown.len()));
    }
    let measured = kept.contacts.iter().filter(|(_, contact)| contact.is_measured).count();
    if measured > 0 {
        let touching: Vec<bool> = kept.contacts.iter().map(|(_, contact)| contact.is_touching).collect();
        let begun = touching.windows(2).filter(|pair| !pair[0] && pair[1]).count() + usize::from(touching[0]);
        let share = touching.iter().filter(|touching| **touching).count() as f64 / measured as f64;
        fact("contacts", format!("{begun}, {:.1} % of the time", 100.0 * share));
    }
    if let Some((_, belief)) = kept.beliefs.last() {
        let after =
            if belief.felt_s.is_nan() { String::new() } else { format!(", after {:.3} s of it", belief.felt_s) };
        fact("poses that explain the push", format!("{}{after}", belief.hypotheses.len()));
    }
    for (key, what) in [("version", "recorded by palpate"), ("system", "on"), ("folder", "in")] {
        if let Some(value) = kept.run.get(key) {
            fact(what, value.clone());
        }
    }
    facts
}

fn table(facts: &[Fact]) -> String {
    let row = |(what, value): &Fact| {
        format!("<tr><th scope=\"row\">{}</th><td>{}</td></tr>\n", escaped(what), escaped(value))
    };
    format!("<table>\n{}</table>\n", facts.iter().map(row).collect::<String>())
}

/// A table with headings; columns of numbers stand right.
fn grid(headings: &[(&str, bool)], rows: impl IntoIterator<Item = Vec<String>>) -> String {
    let class = |is_number: bool| if is_number { " class=\"number\"" } else { " class=\"wide\"" };
    let head: String = headings
        .iter()
        .map(|(name, number)| format!("<th scope=\"col\"{}>{}</th>", class(*number), escaped(name)))
        .collect();
    let row = |cells: Vec<String>| {
        let cells = cells.iter().zip(headings);
        let cells: String =
            cells.map(|(cell, (_, number))| format!("<td{}>{}</td>", class(*number), escaped(cell))).collect();
        format!("<tr>{cells}</tr>\n")
    };
    let body: String = rows.into_iter().map(row).collect();
    format!("<div class=\"scroll\"><table>\n<thead><tr>{head}</tr></thead>\n<tbody>\n{body}</tbody></table></div>\n")
}

/// Figures as they stand in the page.
#[derive(Default)]
struct Figures {
    html: String,
    count: usize,
}

impl Figures {
    /// Puts a figure in. Outlines of characters are named anew, since names are the page's.
    fn add(&mut self, caption: &str, figure: &Figure) {
        self.count += 1;
        let number = self.count;
        let svg = figure.to_page().to_svg();
        let svg =
            svg.replace("id=\"g", &format!("id=\"f{number}g")).replace("href=\"#g", &format!("href=\"#f{number}g"));
        let svg = svg.replacen("<title></title>", &format!("<title>{}</title>", escaped(caption)), 1);
        let _ = write!(self.html, "<figure>\n<figcaption>{}</figcaption>\n{svg}</figure>\n", escaped(caption));
    }

    fn force(&mut self, kept: &Kept, clock: &Clock) {
        let shown: Vec<_> = forces(kept).iter().map(|(at, force)| (clock.since(*at), *force)).collect();
        if shown.is_empty() {
            return;
        }
        let told = kept.inputs.iter().filter(|(_, input)| input.source == "monitor");
        let marks: Vec<_> = told.filter_map(|(at, input)| Some((clock.since(*at), input.line.clone()?))).collect();
        let tare = if kept.tared.is_empty() { "tare included" } else { "less the tare" };
        self.add(&format!("Force on the finger, finger axes, {tare}"), &run::force(&shown, unit(kept), &marks));
    }

    fn contact(&mut self, kept: &Kept, clock: &Clock) {
        let angle = |(at, contact): &(u64, crate::recording::kept::KeptContact)| {
            let gone = f64::NAN;
            let (u, sd) = if contact.is_touching { (contact.u, contact.u_sd) } else { (gone, gone) };
            [clock.since(*at), u.to_degrees(), sd.to_degrees()]
        };
        let angles: Vec<_> = kept.contacts.iter().map(angle).collect();
        if angles.iter().any(|[_, u, _]| u.is_finite()) {
            self.add("Contact angle on the disk, counter-clockwise from the finger's x axis", &run::contact(&angles));
        }
    }

    fn belief(&mut self, kept: &Kept, clock: &Clock) {
        let Some((_, last)) = kept.beliefs.last() else { return };
        let of_part = kept.beliefs.iter().filter(|(_, belief)| belief.part == last.part);
        let beliefs: Vec<Believed> = of_part
            .map(|(at, belief)| {
                (clock.since(*at), belief.hypotheses.iter().map(|it| (it.probability, it.pose)).collect())
            })
            .collect();
        if beliefs.len() > 1 {
            self.add("How sure the pose was", &run::belief(&beliefs));
        }
        let text = kept.attachment("part").map(|part| String::from_utf8_lossy(&part.data).into_owned());
        let file = text.and_then(|text| PolygonFile::parse(&text).ok());
        if let Some(file) = file.filter(|_| last.part == 0 && !last.hypotheses.is_empty()) {
            self.add("Where the part was, in the frame of the finger's motion", &run::plane(&file.part, &beliefs));
        }
    }
}

/// The poses that are left at the end.
fn poses(kept: &Kept) -> Option<String> {
    let (_, last) = kept.beliefs.last()?;
    if last.hypotheses.is_empty() {
        return Some("<p>No pose explains the force.</p>\n".to_owned());
    }
    let headings = [
        ("p", true),
        ("edge", true),
        ("x [mm]", true),
        ("y [mm]", true),
        ("turned [°]", true),
        ("sd x [mm]", true),
        ("sd y [mm]", true),
        ("sd turn [°]", true),
    ];
    let row = |it: &crate::recording::Believed| {
        let sd = |axis: usize| it.covariance.map(|covariance| covariance[(axis, axis)].max(0.0).sqrt());
        let told = |value: Option<f64>, scale: f64, decimals: usize| {
            value.map_or_else(|| "unknown".to_owned(), |value| format!("{:.decimals$}", value * scale))
        };
        let degrees = 1f64.to_degrees();
        vec![
            format!("{:.3}", it.probability),
            it.edge.to_string(),
            told(Some(it.pose.x), 1e3, 3),
            told(Some(it.pose.y), 1e3, 3),
            told(Some(it.pose.theta), degrees, 3),
            told(sd(0), 1e3, 3),
            told(sd(1), 1e3, 3),
            told(sd(2), degrees, 3),
        ]
    };
    let mut text = grid(&headings, last.hypotheses.iter().take(LISTED_MAX).map(row));
    if let Some(more) = last.hypotheses.len().checked_sub(LISTED_MAX).filter(|more| *more > 0) {
        let _ = writeln!(text, "<p>{more} less likely ones are not listed.</p>");
    }
    text += "<p>The part's frame in that of the finger's motion; sd: one standard deviation.</p>\n";
    Some(text)
}

fn log(kept: &Kept, clock: &Clock) -> String {
    let rows = kept.log.iter().take(LOG_MAX).map(|(at, told)| vec![format!("{:.3}", clock.since(*at)), told.clone()]);
    let mut text = grid(&[("s", true), ("", false)], rows);
    if let Some(more) = kept.log.len().checked_sub(LOG_MAX).filter(|more| *more > 0) {
        let _ = writeln!(text, "<p>{more} later lines are in the recording: palpate export, topic /log.</p>");
    }
    text
}

fn attached(kept: &Kept) -> String {
    let rows = kept.attached.iter().map(|(attached, sha256)| {
        vec![attached.role.clone(), attached.name.clone(), attached.data.len().to_string(), sha256.clone()]
    });
    grid(&[("what for", false), ("name", false), ("bytes", true), ("SHA-256", false)], rows)
}

fn channels(kept: &Kept) -> String {
    let rows =
        kept.channels.iter().map(|(topic, told)| vec![topic.clone(), told.schema.clone(), told.messages.to_string()]);
    grid(&[("topic", false), ("type", false), ("messages", true)], rows)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::kept::{Input, KeptContact};

    fn kept() -> Kept {
        let mut kept =
            Kept { unit_of_force: "N".to_owned(), span: Some((1_000_000_000, 3_000_000_000)), ..Kept::default() };
        let words = serde_json::json!(["palpate", "monitor", "-d", "sim:7", "--note", "<script>"]).to_string();
        kept.run = [("command_line".to_owned(), words)].into();
        for k in 0..200_u32 {
            let at = 1_000_000_000 + 10_000_000 * u64::from(k);
            kept.tared.push((at, Vector2::new(f64::from(k) * 0.01, -1.0)));
            let u = if k < 100 { f64::NAN } else { 0.5 };
            let contact =
                KeptContact { is_measured: true, is_touching: k >= 100, u, u_sd: 0.01, force: Vector2::zeros() };
            kept.contacts.push((at, contact));
        }
        kept.inputs.push((2_000_000_000, Input { source: "monitor".to_owned(), line: Some("mark 1".to_owned()) }));
        kept.log.push((1_500_000_000, "a < b".to_owned()));
        kept.counters.push((3_000_000_000, Counters { samples: 8000, missing: 16, ..Counters::default() }));
        kept
    }

    #[test]
    fn a_page_has_numbers_figures_and_warnings_and_needs_nothing_else() {
        let page = page(Path::new("a/run.mcap"), &kept());
        for words in [
            "1970-01-01 00:00:01 UTC",
            "2.000 s",
            "8000 delivered, 16 missing",
            "16 samples are missing.",
            "simulated",
            "50.0 % of the time",
            "aria-label=\"mark 1\"",
            "a &lt; b",
            "<code>palpate monitor -d sim:7 --note &lt;script&gt;</code>",
        ] {
            assert!(page.contains(words), "{words}");
        }
        assert_eq!(page.matches("<figure>").count(), 2);
        // No script, and of the addresses only the names of SVG's own vocabularies.
        let strange = page.split("http").skip(1).find(|rest| !rest.starts_with("://www.w3.org/"));
        assert_eq!(strange, None);
        assert!(!page.contains("<script") && !page.contains("url("));
        // Names are once in a page, and each that is used is there.
        let names: Vec<_> = page.split(" id=\"").skip(1).filter_map(|rest| rest.split('"').next()).collect();
        let mut once = names.clone();
        once.sort_unstable();
        once.dedup();
        assert_eq!(once.len(), names.len());
        for used in page.split("href=\"#").skip(1).filter_map(|rest| rest.split('"').next()) {
            assert!(names.contains(&used), "{used}");
        }
    }

    #[test]
    fn what_is_damaged_or_of_another_tool_is_said_first() {
        let kept = Kept { damage: Some("the file ends at byte 7".to_owned()), ..Kept::default() };
        let page = page(Path::new("x.mcap"), &kept);
        assert!(page.contains("of another tool") && page.contains("the file ends at byte 7"), "{page}");
    }
}
