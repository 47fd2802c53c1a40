//! A frame of the screen: a pure function of the state and the size.
//!
//! Nothing is told by colour alone. Where there is no room for panels the numbers stand in lines.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Modifier, Style};
use ratatui::text::{Line, Span};
use ratatui::widgets::canvas::{Canvas, Circle, Context, Line as Stroke, Points};
use ratatui::widgets::{Block, Paragraph, Sparkline, SparklineBar};

use palpate::finger::contact::{Contact, ContactEstimate};
use palpate::finger::sense::Sensed;

use super::state::{HISTORY_S, State, TRAIL_S};

/// With fewer columns or rows the numbers stand in lines.
const PANELS: (u16, u16) = (72, 20);

/// From so many columns on the disk has half of them; below, what the numbers leave.
const NUMBERS_COLUMNS: u16 = 46;

/// Rows for what was told, where alarms do not need more.
const TOLD_ROWS: u16 = 3;

/// Lines that a contact takes.
const CONTACT_LINES: usize = 4;

/// The disk's picture reaches so many radii from its middle: the longest arrow and a label.
const REACH: f64 = 1.75;

/// Length of the largest force's arrow, radii.
const ARROW: f64 = 0.5;

/// Draws the state.
pub(super) fn draw(frame: &mut Frame<'_>, state: &State) {
    let area = frame.area();
    let alarms = state.alarms();
    if area.width < PANELS.0 || area.height < PANELS.1 {
        let mut lines = vec![header(state)];
        lines.extend(alarms.iter().map(|alarm| alarm_line(alarm)));
        lines.extend(contact_lines(state));
        lines.extend(link_lines(state));
        lines.extend(state.told.iter().rev().take(1).map(|told| Line::raw(told.clone())));
        let [body, keys] = Layout::vertical([Constraint::Min(0), Constraint::Length(1)]).areas(area);
        frame.render_widget(Paragraph::new(lines), body);
        frame.render_widget(keys_line(), keys);
        return;
    }
    // However many alarms there are, all are seen.
    let told_rows = u16::try_from(alarms.len()).unwrap_or(u16::MAX).max(TOLD_ROWS);
    let rows =
        [1, 0, 4, told_rows, 1].map(|rows| if rows == 0 { Constraint::Min(0) } else { Constraint::Length(rows) });
    let [head, body, force, told, keys] = Layout::vertical(rows).areas(area);
    frame.render_widget(header(state), head);
    let numbers = NUMBERS_COLUMNS.max(area.width / 2).min(NUMBERS_COLUMNS + 20);
    let [disk, numbers] = Layout::horizontal([Constraint::Min(0), Constraint::Length(numbers)]).areas(body);
    draw_disk(frame, disk, state);
    let mut lines = contact_lines(state);
    lines.resize(CONTACT_LINES, Line::raw(""));
    lines.extend(bridge_lines(state));
    lines.push(heading("link".to_owned()));
    lines.extend(link_lines(state));
    frame.render_widget(Paragraph::new(lines).block(Block::bordered().title(" contact ")), numbers);
    draw_force(frame, force, state);
    let told_lines: Vec<_> = state.told.iter().flat_map(|line| folded(line, told.width)).collect();
    let room = usize::from(told.height).saturating_sub(alarms.len());
    let newest = told_lines.into_iter().rev().take(room).collect::<Vec<_>>().into_iter().rev();
    let lines: Vec<_> = alarms.iter().map(|alarm| alarm_line(alarm)).chain(newest).collect();
    frame.render_widget(Paragraph::new(lines), told);
    frame.render_widget(keys_line(), keys);
}

/// A text in lines of so many columns, broken between words; longer words are cut by the edge.
fn folded(text: &str, columns: u16) -> Vec<Line<'static>> {
    let mut lines = vec![String::new()];
    for word in text.split_whitespace() {
        let line = lines.last().map_or(0, |line| line.chars().count());
        if line > 0 && line + 1 + word.chars().count() > usize::from(columns) {
            lines.push("  ".to_owned());
        }
        if let Some(line) = lines.last_mut() {
            line.push(' ');
            line.push_str(word);
        }
    }
    lines.into_iter().map(Line::raw).collect()
}

fn heading(text: String) -> Line<'static> {
    Line::from(Span::styled(text, Style::new().add_modifier(Modifier::UNDERLINED)))
}

fn header(state: &State) -> Line<'_> {
    let finger = &state.finger;
    let simulated = if finger.is_simulated { " SIMULATED" } else { "" };
    let text = format!("{simulated} finger {}  {}  {:.1} s", finger.device, finger.address, state.t);
    Line::from(Span::styled(text, Style::new().add_modifier(Modifier::BOLD)))
}

fn alarm_line(alarm: &str) -> Line<'static> {
    let style = Style::new().fg(Color::Red).add_modifier(Modifier::BOLD | Modifier::REVERSED);
    Line::from(Span::styled(format!(" ! {alarm} "), style))
}

fn keys_line() -> Line<'static> {
    let key = |key: &'static str, what: &'static str| {
        [
            Span::styled(format!(" {key} "), Style::new().add_modifier(Modifier::REVERSED)),
            Span::raw(format!(" {what}  ")),
        ]
    };
    let keys = [key("t", "tare"), key("r", "record"), key("m", "mark"), key("q", "quit")];
    Line::from(keys.into_iter().flatten().collect::<Vec<_>>())
}

fn contact_lines(state: &State) -> Vec<Line<'static>> {
    let unit = state.finger.unit;
    let mut lines = Vec::new();
    match &state.felt {
        None => lines.push(Line::raw("")),
        Some(Sensed::NotMeasured { .. }) => lines.push(Line::raw("not measuring")),
        Some(Sensed::Contact(reading)) => match &reading.contact {
            Contact::Free { force_finger, sigmas } => {
                lines.push(Line::raw(format!("no contact ({sigmas:.1} sigma)")));
                lines.push(Line::raw(format!("force  {:8.4} {unit}", force_finger.norm())));
                lines.push(Line::raw(format!("x, y   {:8.4}, {:8.4} {unit}", force_finger.x, force_finger.y)));
            }
            Contact::Touching(touch) => {
                let friction = match touch.friction_half_angle {
                    half if half > 0.0 => format!(" ± {:.1} (friction)", half.to_degrees()),
                    _ => String::new(),
                };
                let (u, sd) = (touch.u.to_degrees(), touch.u_sd.to_degrees());
                let at = format!("at     {u:8.2}° ± {sd:.2}{friction}");
                lines.push(Line::from(Span::styled(at, Style::new().add_modifier(Modifier::BOLD))));
                lines.push(Line::raw(format!("force  {:8.4} ± {:.4} {unit}", touch.magnitude, touch.magnitude_sd)));
                let force = touch.force_finger;
                lines.push(Line::raw(format!("x, y   {:8.4}, {:8.4} {unit}", force.x, force.y)));
                lines.push(Line::raw(format!("since  {:8.1} s", reading.t - touch.onset)));
            }
        },
    }
    lines
}

fn bridge_lines(state: &State) -> Vec<Line<'static>> {
    let text = |name: &str, values: [String; 2]| format!("{name:<11}{:>16}{:>16}", values[0], values[1]);
    let row = |name: &str, values: [String; 2]| Line::raw(text(name, values));
    let (unit, bridges) = (state.finger.unit, state.bridges.as_ref());
    let strain = |axis: usize| {
        let shown = |value: &super::state::Bridges| {
            format!("{:.1} ({:.0} %)", value.microstrain[axis], 100.0 * value.range[axis])
        };
        bridges.map_or("-".to_owned(), shown)
    };
    let noise = |axis: usize| match bridges.and_then(|bridges| bridges.noise) {
        Some(noise) => format!("{:.4}", noise[axis]),
        None => "-".to_owned(),
    };
    let tare = |axis: usize| state.tare.map_or("-".to_owned(), |tare| format!("{:.4}", tare.bias[axis]));
    vec![
        heading(text("bridges", ["x".to_owned(), "y".to_owned()])),
        row("µm/m", [strain(0), strain(1)]),
        row(&format!("noise {unit}"), [noise(0), noise(1)]),
        row(&format!("tare {unit}"), [tare(0), tare(1)]),
    ]
}

fn link_lines(state: &State) -> Vec<Line<'static>> {
    let rate = state.bridges.map_or("-".to_owned(), |bridges| format!("{:.0}", bridges.rate_hz));
    let temperature = state.temperature_c.map_or(String::new(), |celsius| format!(", {celsius:.1} °C"));
    let counts = &state.counts;
    let breaks = match counts.disconnections {
        0 => String::new(),
        times => format!(", breaks: {times}"),
    };
    let mut lines = vec![Line::raw(format!("{rate} of {} samples/s{temperature}{breaks}", state.finger.rate_hz))];
    let (missing, damaged) = (counts.missing, counts.damaged_frames);
    lines.push(Line::raw(format!("{} samples: {missing} missing, {damaged} damaged", counts.samples)));
    let tare = match (state.is_taring, state.tare) {
        (true, _) => "TARING: keep the finger free".to_owned(),
        (false, None) => "not tared".to_owned(),
        (false, Some(tare)) => match tare.at {
            Some(at) => format!("tared {:.0} s ago", (state.t - at).max(0.0)),
            None => "tared earlier".to_owned(),
        },
    };
    let inputs = state.inputs.map_or(String::new(), |levels| format!(", inputs {levels:08b}"));
    lines.push(Line::raw(tare + &inputs));
    lines.push(match &state.recording {
        Some(recording) if recording.goes_on => {
            let marks = match recording.marks {
                0 => String::new(),
                marks => format!(", marks: {marks}"),
            };
            let lasts = recording.since.map_or(0.0, |since| state.t - since);
            Line::raw(format!("● {} {lasts:.0} s{marks}", recording.file))
        }
        _ => Line::raw("not recorded"),
    });
    lines
}

/// The disk as the finger's axes see it, the angle that reads 0 to the right: contact, its uncertainty, its trail.
fn draw_disk(frame: &mut Frame<'_>, area: Rect, state: &State) {
    let block = Block::bordered().title(" finger ");
    let inner = block.inner(area);
    // Dots of braille, two by four a cell, are about as wide as high.
    let (width, height) = (f64::from(inner.width) * 2.0, f64::from(inner.height) * 4.0);
    let per_dot = 2.0 * REACH / width.min(height).max(1.0);
    let (half_width, half_height) = (0.5 * width * per_dot, 0.5 * height * per_dot);
    let canvas = Canvas::default()
        .block(block)
        .x_bounds([-half_width, half_width])
        .y_bounds([-half_height, half_height])
        .paint(|context| paint_disk(context, state));
    frame.render_widget(canvas, area);
}

fn at(angle: f64, radius: f64) -> (f64, f64) {
    let (sin, cos) = angle.sin_cos();
    (radius * cos, radius * sin)
}

fn paint_disk(context: &mut Context<'_>, state: &State) {
    context.draw(&Circle { x: 0.0, y: 0.0, radius: 1.0, color: Color::Reset });
    for (angle, label) in [(0.0, "0°"), (FRAC_PI_2, "90°"), (PI, "180°"), (-FRAC_PI_2, "-90°")] {
        let (x, y) = at(angle, 0.72);
        context.print(x - 0.12, y, label);
    }
    let recent = state.history.iter().filter(|past| state.t - past.t < TRAIL_S);
    let trail: Vec<_> = recent.filter_map(|past| past.u).map(|u| at(u, 0.9)).collect();
    context.draw(&Points { coords: &trail, color: Color::DarkGray });
    if let Some(Sensed::Contact(reading)) = &state.felt
        && let Some(touch) = reading.contact.touch()
    {
        paint_touch(context, touch, state.largest());
    }
}

fn paint_touch(context: &mut Context<'_>, touch: &ContactEstimate, largest: f64) {
    /// Points of the arc in which the contact is, over the whole circle.
    const ARC_POINTS: f64 = 180.0;
    let half = (touch.friction_half_angle + 2.0 * touch.u_sd).min(PI);
    let points = (2.0 * half / TAU * ARC_POINTS).ceil();
    let places = std::iter::successors(Some(0.0), |place| Some(place + 1.0)).take_while(|place| *place <= points);
    let arc: Vec<_> = places.map(|place| at(touch.u - half + 2.0 * half * place / points.max(1.0), 1.08)).collect();
    context.draw(&Points { coords: &arc, color: Color::Yellow });
    let share = if largest > 0.0 { (touch.magnitude / largest).min(1.0) } else { 0.0 };
    let (tip, tail) = (at(touch.u, 1.1), at(touch.u, 1.1 + ARROW * share));
    let mut stroke = |(x1, y1): (f64, f64), (x2, y2): (f64, f64)| {
        context.draw(&Stroke { x1, y1, x2, y2, color: Color::Cyan });
    };
    stroke(tail, tip);
    stroke(tip, at(touch.u + 0.1, 1.25));
    stroke(tip, at(touch.u - 0.1, 1.25));
}

/// The size of the force over the history, the newest to the right.
fn draw_force(frame: &mut Frame<'_>, area: Rect, state: &State) {
    /// Steps of the highest bar.
    const STEPS: f64 = 1000.0;
    let largest = state.largest();
    let title = format!(" force, last {HISTORY_S:.0} s; highest {largest:.4} {} ", state.finger.unit);
    let block = Block::bordered().title(title);
    let columns = usize::from(block.inner(area).width);
    let mut bars: Vec<Option<f64>> = vec![None; columns];
    for past in &state.history {
        let age = (state.t - past.t).max(0.0) / HISTORY_S;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "from 0 to a terminal's width")]
        let back = (age * columns as f64) as usize;
        if let Some(bar) = columns.checked_sub(back + 1).and_then(|place| bars.get_mut(place)) {
            *bar = match (*bar, past.magnitude) {
                (Some(highest), Some(now)) => Some(highest.max(now)),
                (highest, now) => highest.or(now),
            };
        }
    }
    let scale = if largest > 0.0 { STEPS / largest } else { 0.0 };
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "from 0 to STEPS")]
    let height = |force: f64| (force * scale) as u64;
    let bars: Vec<_> = bars.into_iter().map(|bar| SparklineBar::from(bar.map(height))).collect();
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a constant of 1000")]
    let sparkline = Sparkline::default().data(bars).max(STEPS as u64).absent_value_symbol(" ").block(block);
    frame.render_widget(sparkline, area);
}
