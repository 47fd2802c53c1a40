//! `palpate inscribe --passing`: parts that are carried past light barriers and turning beams, each placed as it has gone by.

use std::process::ExitCode;

use palpate::inscription::{NoisyReadings, Passage, Passages};
use palpate_files::bits::{BitChange, BitError};
use palpate_files::passing::PassingFile;
use palpate_files::views::{NamedPart, Views};
use serde_json::json;

use super::counted;
use super::device::DeviceArguments;
use super::inscribe::{Found, find, json as found_json, tell as tell_found};
use super::plot::PlotArguments;
use super::switches::{Heard, listen};
use crate::pictures::inscription::{Passed, passed};
use crate::width::folded;

/// Places parts as they go by, until nobody tells more.
pub(super) fn follow(
    parts: &[NamedPart],
    file: &PassingFile,
    device: &DeviceArguments,
    is_json: bool,
    plot: &PlotArguments,
) -> miette::Result<ExitCode> {
    let mut line = Line {
        parts,
        file,
        is_json,
        passages: Passages::new(&file.beams, file.debounce),
        last: f64::NEG_INFINITY,
        is_behind: false,
        passed: 0,
        drawn: plot.is_asked().then(Vec::new),
    };
    let count = file.ids.iter().copied().max().unwrap_or_default();
    let is_all = listen(device, count, |heard| line.hear(heard))?;
    if line.passed == 0 {
        note!("no part has gone by all barriers");
    }
    let drawn = line.drawn.unwrap_or_default();
    plot.draw(|| {
        let names: Vec<_> = parts.iter().map(|part| part.name.as_str()).collect();
        let title = format!("{} carried past beams", names.join(", "));
        let [vx, vy] = [file.velocity.x, file.velocity.y].map(|speed| speed * 1e3);
        let when = format!("each where it was as the last barrier was free again, carried by ({vx:.1}, {vy:.1}) mm/s");
        Ok(passed(&title, &[when], &drawn))
    })?;
    Ok(if is_all { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// What carries parts past beams.
struct Line<'a> {
    parts: &'a [NamedPart],
    file: &'a PassingFile,
    is_json: bool,
    passages: Passages,
    /// Time of the last change, s.
    last: f64,
    /// Whether it was told that a barrier sees nothing.
    is_behind: bool,
    /// Parts so far.
    passed: usize,
    /// Those that a picture shows, where one is asked for.
    drawn: Option<Vec<Passed>>,
}

impl Line<'_> {
    fn hear(&mut self, heard: Heard) -> Result<(), String> {
        match heard {
            Heard::Change(BitChange { t, point, covered }) => {
                // A board tells of inputs that the file does not name.
                let Some(place) = self.file.place(point + 1) else { return Ok(()) };
                if t < self.last {
                    return Err(BitError::Back { t, before: self.last }.to_string());
                }
                self.last = t;
                self.passages.change(place, t, covered);
            }
            Heard::Until(time) => self.passages.until(time),
            Heard::Quiet => self.passages.end(),
        }
        while let Some(passage) = self.passages.next_passage() {
            self.tell(&passage);
        }
        if let Some(place) = self.passages.behind().filter(|_| !self.is_behind) {
            self.is_behind = true;
            note!("barrier {} has seen no part while others saw several: is it cut, or dark?", self.file.ids[place]);
        }
        Ok(())
    }

    fn tell(&mut self, passage: &Passage) {
        self.passed += 1;
        let readings = passage.readings(&self.file.beams, self.file.velocity, self.file.bearing_sigma);
        if passage.is_crowded && !self.is_json {
            note!("another part was among the barriers: turning beams are left out, since they saw both");
        }
        let views = Views {
            cones: Vec::new(),
            // What is felt is used; these are for pictures.
            readings: NoisyReadings {
                bearings: readings.bearings.clone(),
                fences: readings.fences.iter().map(|fence| fence.line).collect(),
                sigma: readings.bearing_sigma,
            },
            points: Vec::new(),
            noisy: true,
            felt: Some(readings),
        };
        let found: Vec<_> = self.parts.iter().map(|part| find(part.clone(), &views)).collect();
        if self.is_json {
            let mut object = found_json(&found, &views, None);
            object["t"] = json!(passage.end);
            object["velocity"] = json!([self.file.velocity.x, self.file.velocity.y]);
            object["crowded"] = json!(passage.is_crowded);
            say!("{object}");
        } else {
            let [vx, vy] = [self.file.velocity.x, self.file.velocity.y].map(|speed| speed * 1e3);
            let gone = format!(
                "{:.3} s: part {} has gone by; where it is now, going on by ({vx:.1}, {vy:.1}) mm/s",
                passage.end, self.passed
            );
            say!("{}", folded(&gone));
            tell_found(&found, &views, None);
        }
        if let Some(drawn) = &mut self.drawn {
            let poses: Vec<_> = found.iter().flat_map(Found::placed).collect();
            let words = format!("{}: {:.3} s, {}", self.passed, passage.end, counted(poses.len(), "pose"));
            drawn.push(Passed { views, poses, words });
        }
    }
}
