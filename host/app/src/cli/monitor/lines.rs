//! The lines of `palpate monitor`, for people and for programs.

use std::io::{self, Write as _};

use palpate::finger::contact::{Contact, ContactReading, detector};
use palpate::finger::monitor::MonitorLine;
use palpate::finger::sense::Sensed;
use palpate_device::session::InputLevels;
use palpate_device::{Incoming, Session};
use serde_json::{Value, json};

use super::super::lacking;
use crate::live;

/// What happened beside the samples: for a person on standard error, for a program in the stream.
pub(super) fn tell(json: bool, incoming: &Incoming) {
    if !json {
        if let Incoming::Inputs(inputs) = incoming {
            // If nobody reads, the next line of samples finds out.
            let _ = write_line(&inputs_in_words(inputs));
        }
        return crate::cli::tell(incoming);
    }
    let what = match incoming {
        Incoming::Event(event) => json!({ "device": live::in_words(event.kind) }),
        Incoming::Silent { after } => json!({ "link": "silent", "after_s": after.as_secs_f64() }),
        Incoming::Disconnected { reason } => json!({ "link": "lost", "reason": reason }),
        Incoming::Reconnected { after, countable } => {
            json!({ "link": "back", "after_s": after.as_secs_f64(), "missing_counted": countable })
        }
        Incoming::Restarted(_) => json!({ "device": "started anew; its settings were restored" }),
        Incoming::Inputs(inputs) => json!({
            "t": inputs_t(inputs), "inputs": inputs.levels, "changes": inputs.changes,
        }),
        Incoming::Force(force) => json!({
            "t": force.time_us as f64 * 1e-6, "device_force": force.force_finger, "agrees": force.agrees,
        }),
        Incoming::Samples(_) | Incoming::Temperature(_) | Incoming::SlowChannels(_) => return,
    };
    // If nobody reads, the next line of samples finds out.
    let _ = write_line(&what.to_string());
}

/// When inputs were first read so, device time in s.
fn inputs_t(inputs: &InputLevels) -> f64 {
    inputs.time_us as f64 * 1e-6
}

/// Digital inputs for a person, input 0 on the right.
pub(super) fn inputs_in_words(inputs: &InputLevels) -> String {
    let changes = match inputs.changes {
        0 => "at the start".to_owned(),
        1 => "one change".to_owned(),
        changes => format!("{changes} changes"),
    };
    format!("{:9.3} s  inputs 7..0: {:08b}, {changes}", inputs_t(inputs), inputs.levels)
}

/// Writes a line at once: somebody waits for it.
pub(super) fn write_line(line: &str) -> io::Result<()> {
    let mut out = io::stdout().lock();
    writeln!(out, "{line}").and_then(|()| out.flush())
}

/// A line for a person.
pub(super) fn in_words(session: &Session, line: &MonitorLine, unit: &str) -> String {
    let mark = if session.is_simulated() { "  [simulated]" } else { "" };
    match &line.sensed {
        Sensed::Contact(reading) => format!("{}{mark}", reading_in_words(reading, unit)),
        Sensed::NotMeasured { t, fault } => format!("{t:9.3} s  NOT MEASURING: {fault}{mark}"),
    }
}

fn reading_in_words(reading: &ContactReading, unit: &str) -> String {
    match &reading.contact {
        Contact::Free { sigmas, .. } => format!("{:9.3} s  no contact ({sigmas:.1} sigma)", reading.t),
        Contact::Touching(touch) => {
            let friction = if touch.friction_half_angle > 0.0 {
                format!(" ± {:.1} (friction)", touch.friction_half_angle.to_degrees())
            } else {
                String::new()
            };
            format!(
                "{:9.3} s  at {:7.2}° ± {:.2}{friction}, {:.4} ± {:.4} {unit}",
                reading.t,
                touch.u.to_degrees(),
                touch.u_sd.to_degrees(),
                touch.magnitude,
                touch.magnitude_sd,
            )
        }
    }
}

/// A line for a program: s, rad, and force in `unit` (`N`, or the calibration's relative unit). `t` is on the device's
/// clock, `unix_time` on the host's; `temperature_c` is the board's, null where it has told none; `contact` is null where nothing was measured; `missing_before` counts since the
/// line before, `samples` since the tare.
pub(super) fn as_json(session: &Session, line: &MonitorLine, unit: &str) -> Value {
    let sensed = &line.sensed;
    let t = match sensed {
        Sensed::Contact(reading) => reading.t,
        Sensed::NotMeasured { t, .. } => *t,
    };
    let mut told = json!({
        "t": t,
        "unix_time": session.unix_time_s(t),
        "simulated": session.is_simulated(),
        "unit": unit,
        "temperature_c": session.temperature_c(),
        "missing_before": line.since_last.missing,
        "samples": lacking::as_json(&line.since_start),
    });
    let more = match sensed {
        Sensed::NotMeasured { fault, .. } => json!({ "contact": null, "fault": fault.to_string() }),
        Sensed::Contact(reading) => contact_as_json(reading),
    };
    if let (Value::Object(told), Value::Object(more)) = (&mut told, more) {
        told.extend(more);
    }
    told
}

fn contact_as_json(reading: &ContactReading) -> Value {
    let event = reading.event.map(|event| match event {
        detector::Event::Onset { .. } => "onset",
        detector::Event::Release { .. } => "release",
    });
    match &reading.contact {
        Contact::Free { force_finger, sigmas } => json!({
            "contact": false, "event": event, "sigmas": sigmas, "force": [force_finger.x, force_finger.y],
        }),
        Contact::Touching(touch) => json!({
            "contact": true, "event": event, "u": touch.u, "u_sd": touch.u_sd,
            "friction_half_angle": touch.friction_half_angle, "force": [touch.force_finger.x, touch.force_finger.y],
            "magnitude": touch.magnitude, "magnitude_sd": touch.magnitude_sd, "onset": touch.onset,
        }),
    }
}
