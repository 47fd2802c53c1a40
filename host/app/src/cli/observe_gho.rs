//! `palpate observe --method gho`: the thesis's observers on what a finger feels.

use std::f64::consts::PI;
use std::ops::ControlFlow;
use std::path::Path;
use std::process::ExitCode;

use nalgebra::Vector2;
use palpate::finger::contact::Reading;
use palpate::gravity::GRAVITY_ASSUMED;
use palpate::math::angle::{contact_angle, wrap_angle};
use palpate::pushing::dynamics::{ContactMode, Part, State};
use palpate::pushing::estimation::{GhoFollower, GhoKnown, GhoSettings, GhoStart, GhoTold};
use palpate::pushing::finger_motion::FingerMotion;
use palpate_files::part::PolygonFile;
use serde_json::{Value, json};

use super::motion_source::AskedMotion;
use super::observed_plot::{self, Heading};
use super::plot::PlotArguments;
use super::pose::columns;
use super::watched_push::{Ongoing, Watched, WatchedPushArguments, Watching, too_short};
use super::{lacking, not_negative, positive};
use crate::pictures::plot::Figure;
use crate::recording::{self, Believed, Seen};
use crate::width::folded;

/// Means of the force over two hundredths of a second, a period of the mains, go to the observer each hundredth: the thesis's
/// rate.
const MEAN_S: f64 = 0.02;
/// See [`MEAN_S`].
const EVERY_S: f64 = 0.01;

/// ζ of the thesis, 1/s.
const ZETA: f64 = 10.0;

/// Observers of one reading that a person is shown.
const SHOWN: usize = 3;

/// Widths of the columns: time, edge, centre of mass, turn, place on the edge, velocity, turning, miss.
const WIDTHS: [usize; 10] = [5, 5, 8, 8, 8, 7, 7, 7, 8, 7];

/// What the thesis's observers need.
#[derive(Clone, Copy, Debug, clap::Args)]
#[command(next_help_heading = "The thesis's observers (--method gho)")]
pub(super) struct GhoArguments {
    /// How finger and part are taken to touch [default: frictionless]
    #[arg(long, value_enum)]
    contact: Option<GhoContact>,

    /// ζ: minus the poles of the observer, 1/s; too small never arrives, too large diverges [default: 10]
    #[arg(long, value_name = "1/S", value_parser = positive)]
    zeta: Option<f64>,

    /// For how long the correction is on and off in turn, s [default: 0.06,0.04]
    #[arg(long, value_name = "ON,OFF", value_parser = correction)]
    correction_s: Option<Correction>,

    /// The only edge that may be in contact, as in the part file, from 0 [default: an observer for each]
    #[arg(long, value_name = "N")]
    edge: Option<usize>,

    /// Begin each observer with this: contact angle in degrees, place on the edge in mm, turning in °/s, speed along the edge in
    /// mm/s; what is left out at the end is 0 [default: the first angle felt, the middle of the edge, 0, 0]
    #[arg(long, value_name = "U,S,OMEGA,VT", value_parser = initial, allow_hyphen_values = true)]
    initial_estimate: Option<Initial>,
}

/// How finger and part are taken to touch.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
enum GhoContact {
    /// Without friction: then the force points along the contact's normal, as the observer needs
    #[default]
    Frictionless,
    /// Rolling: friction turns the force off the normal, which the observer does not know
    Rolling,
}

/// Times on and off, s.
#[derive(Clone, Copy, Debug)]
struct Correction([f64; 2]);

fn correction(text: &str) -> Result<Correction, String> {
    let (on, off) = text.split_once(',').ok_or_else(|| format!("{text:?} is not ON,OFF in seconds"))?;
    Ok(Correction([positive(on.trim())?, not_negative(off.trim())?]))
}

/// A first estimate: rad, m, rad/s, m/s.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Initial([f64; 4]);

fn initial(text: &str) -> Result<Initial, String> {
    let values: Result<Vec<f64>, _> = text.split(',').map(|value| super::finite(value.trim())).collect();
    let values = values?;
    if !(2..=4).contains(&values.len()) {
        return Err(format!("{text:?} is not U,S or U,S,OMEGA or U,S,OMEGA,VT"));
    }
    let of = |place: usize, scale: f64| values.get(place).copied().unwrap_or(0.0) * scale;
    Ok(Initial([of(0, PI / 180.0), of(1, 1e-3), of(2, PI / 180.0), of(3, 1e-3)]))
}

impl GhoArguments {
    /// Whether any of it was asked for.
    pub(super) fn is_given(&self) -> bool {
        let Self { contact, zeta, correction_s, edge, initial_estimate } = self;
        contact.is_some() || zeta.is_some() || correction_s.is_some() || edge.is_some() || initial_estimate.is_some()
    }

    fn start(&self, part: &Part) -> miette::Result<GhoStart> {
        let edges = part.polygon().vertices().len();
        if let Some(edge) = self.edge.filter(|edge| *edge >= edges) {
            let help = format!("its edges are 0 to {}", edges - 1);
            return Err(miette::miette!(help = help, "the part has no edge {edge}"));
        }
        let told = GhoStart { edge: self.edge, ..GhoStart::default() };
        Ok(self.initial_estimate.map_or(told, |Initial([u, s, omega, v_t])| GhoStart {
            u: Some(u),
            s: Some(s),
            omega,
            v_t,
            ..told
        }))
    }

    fn mode(&self) -> ContactMode {
        match self.contact.unwrap_or_default() {
            GhoContact::Frictionless => ContactMode::Frictionless,
            GhoContact::Rolling => ContactMode::Rolling,
        }
    }

    /// What the answer rests on.
    fn assumptions(&self, file: &PolygonFile) -> Vec<String> {
        let direction = match self.contact.unwrap_or_default() {
            GhoContact::Frictionless => {
                "the contact slides without friction, so that the direction opposite to the force is that of the contact: friction \
                 at the finger turns it by up to atan mu_c, and no more is known of that"
            }
            GhoContact::Rolling => {
                "the contact rolls throughout, and still the direction opposite to the force is taken for that of the contact: it is \
                 off by the angle of the friction, up to atan mu_c"
            }
        };
        let mut all = vec![
            direction.to_owned(),
            format!("mu {} is exact, and the part too", file.mu),
            "the contact lasts, on one edge".to_owned(),
        ];
        if self.initial_estimate.is_none() {
            all.push("the part hardly turns at first, and is touched near the middle of an edge: the thesis's observers are local".to_owned());
        }
        all
    }
}

/// A push that the thesis's observers follow.
pub(super) struct GhoPush<'f> {
    pub(super) file: &'f PolygonFile,
    pub(super) arguments: GhoArguments,
    /// Print every so many seconds of the push.
    pub(super) every_s: f64,
    pub(super) json: bool,
}

/// What was followed so far.
struct Following<'f> {
    push: &'f GhoPush<'f>,
    follower: GhoFollower,
    /// Middle of the next mean, s since the onset.
    next: f64,
    last_printed: f64,
    is_headed: bool,
    /// The best observer's pose of each reading.
    trail: Vec<(f64, GhoTold)>,
    felt: Vec<(f64, Vector2<f64>)>,
}

impl GhoPush<'_> {
    /// Follows a push to the end of the finger's motion, or of the contact.
    pub(super) fn run(
        &self,
        push: &WatchedPushArguments,
        motion: &Path,
        plot: &PlotArguments,
        title: impl FnOnce() -> String,
    ) -> miette::Result<ExitCode> {
        let mut following = Following {
            push: self,
            follower: GhoFollower::new(self.arguments.start(&self.file.part)?, self.settings()),
            next: 0.5 * MEAN_S,
            last_printed: f64::NEG_INFINITY,
            is_headed: false,
            trail: Vec::new(),
            felt: Vec::new(),
        };
        let watching = Watching { every_s: f64::INFINITY, watched: Watched::Push };
        let mut figure = None;
        let pushed = push.watch(AskedMotion::Told(motion), watching, &mut |ongoing| {
            following.look(ongoing);
            let is_over = ongoing.is_over();
            if is_over {
                figure = Some(following.conclude(ongoing));
            }
            Ok(if is_over { ControlFlow::Break(()) } else { ControlFlow::Continue(()) })
        })?;
        pushed.was_felt()?;
        if following.trail.is_empty() {
            return Err(too_short());
        }
        if !self.json {
            say!("{}\n{}", legend(), folded(&self.in_words(&following)));
        }
        if let Some(figure) = figure {
            plot.draw(|| Ok(figure(title())))?;
        }
        Ok(lacking::status(&pushed.watch.tally()))
    }

    fn settings(&self) -> GhoSettings {
        let thesis = GhoSettings::new(self.arguments.zeta.unwrap_or(ZETA));
        self.arguments.correction_s.map_or(thesis, |Correction([correction_on, correction_off])| GhoSettings {
            correction_on,
            correction_off,
            ..thesis
        })
    }

    fn known<'k>(&'k self, motion: &'k FingerMotion, radius: f64) -> GhoKnown<'k> {
        let (mu_g, contact) = (self.file.mu * GRAVITY_ASSUMED, self.arguments.mode());
        GhoKnown { part: &self.file.part, mu_g, radius, motion, contact }
    }

    fn in_words(&self, following: &Following<'_>) -> String {
        let begun = following.follower.begun().unwrap_or(0.0);
        format!(
            "The thesis's observers give no uncertainty, and the best may be wrong. They began {begun:.2} s after the finger did, once \
             it moved. Assumed: {}.",
            self.arguments.assumptions(self.file).join("; ")
        )
    }
}

impl Following<'_> {
    fn look(&mut self, ongoing: &Ongoing<'_>) {
        let Some(sense) = ongoing.watch.sense().filter(|sense| sense.onset_time().is_some()) else { return };
        let now = sense.now() - sense.onset_time().unwrap_or(0.0);
        let known = self.push.known(ongoing.motion, ongoing.felt.radius());
        while self.next + 0.5 * MEAN_S <= now.min(ongoing.motion.duration()) {
            let time = self.next;
            self.next += EVERY_S;
            let Some(force) = mean(sense.readings(), time) else { continue };
            let own = ongoing.felt.carried().effective_mass;
            let force = force + ongoing.motion.acceleration(time) * own;
            self.felt.push((time, force));
            self.follower.take(&known, time, contact_angle(force));
            let told = self.follower.told(&known);
            let Some(best) = told.first() else { continue };
            self.trail.push((time, *best));
            if time >= self.last_printed + self.push.every_s {
                self.print(time, &told, ongoing);
            }
        }
    }

    fn print(&mut self, time: f64, told: &[GhoTold], ongoing: &Ongoing<'_>) {
        self.last_printed = time;
        // Shares alike: none has a probability.
        let share = 1.0 / told.len().max(1) as f64;
        let believed =
            told.iter().map(|it| Believed { probability: share, edge: it.edge, pose: it.pose, covariance: None });
        let (motion, radius) = (ongoing.motion, ongoing.felt.radius());
        recording::believed(Seen::pushed(&self.push.file.part, motion, radius, time), believed);
        if self.push.json {
            let mut object = as_json(time, told, &self.push.arguments.assumptions(self.push.file));
            object["samples"] = lacking::as_json(&ongoing.watch.tally());
            say!("{object}");
            return;
        }
        if !self.is_headed {
            say!("{}", headings());
            self.is_headed = true;
        }
        told.iter().take(SHOWN).for_each(|it| say!("{}", line(&self.push.file.part, time, it)));
        if told.len() > SHOWN {
            say!("{}  and {} more", columns(&[format!("{time:.2}")], &WIDTHS), told.len() - SHOWN);
        }
    }

    /// The last estimates are told whenever they were due; what a picture of the push shows, by its title.
    fn conclude(&mut self, ongoing: &Ongoing<'_>) -> impl FnOnce(String) -> Figure + use<> {
        let known = self.push.known(ongoing.motion, ongoing.felt.radius());
        if let Some((time, _)) = self.trail.last().filter(|(time, _)| *time > self.last_printed) {
            self.print(*time, &self.follower.told(&known), ongoing);
        }
        let trail: Vec<_> = self.trail.iter().map(|(time, told)| (*time, told.pose)).collect();
        let (part, radius, felt) = (self.push.file.part.clone(), known.radius, self.felt.clone());
        let (motion, words) = (ongoing.motion.clone(), self.push.in_words(self));
        move |title| observed_plot::trailed((&part, radius), &motion, &trail, &felt, &Heading { title, words })
    }
}

/// Mean force about a time; none where readings are missing.
fn mean(readings: &[Reading], time: f64) -> Option<Vector2<f64>> {
    let from = readings.partition_point(|reading| reading.t < time - 0.5 * MEAN_S);
    let to = readings.partition_point(|reading| reading.t < time + 0.5 * MEAN_S);
    let inside = &readings[from..to];
    (!inside.is_empty())
        .then(|| inside.iter().map(|reading| reading.force_finger).sum::<Vector2<f64>>() / inside.len() as f64)
}

fn line(part: &Part, time: f64, told: &GhoTold) -> String {
    let centre = told.pose.isometry() * part.centre_of_mass();
    let cells = [
        format!("{time:.2}"),
        told.edge.to_string(),
        format!("{:.2}", centre.x * 1e3),
        format!("{:.2}", centre.y * 1e3),
        format!("{:.2}", wrap_angle(told.pose.theta).to_degrees()),
        format!("{:.2}", told.state.s * 1e3),
        format!("{:.1}", told.velocity.x * 1e3),
        format!("{:.1}", told.velocity.y * 1e3),
        format!("{:.1}", told.state.omega.to_degrees()),
        format!("{:.2}", told.missed.to_degrees()),
    ];
    columns(&cells, &WIDTHS)
}

fn headings() -> String {
    let names = ["felt", "edge", "x", "y", "turned", "at", "vx", "vy", "turning", "missed"];
    let units = ["[s]", "", "[mm]", "[mm]", "[°]", "[mm]", "[mm/s]", "[mm/s]", "[°/s]", "[°]"];
    format!("{}\n{}", columns(&names, &WIDTHS), columns(&units, &WIDTHS))
}

fn legend() -> String {
    folded(
        "felt: time since the finger began to move. edge: the one the observer takes to be in contact, as in the part file, from 0. \
         x, y, turned: the part's centre of mass, and how far the part is turned. at: where on its edge the contact is. vx, vy, \
         turning: velocity of the centre of mass, and how fast the part turns. missed: how far the observer's contact angle was from \
         the felt one of late; the one that missed least comes first.",
    )
}

fn as_json(time: f64, told: &[GhoTold], assumed: &[String]) -> Value {
    let hypothesis = |it: &GhoTold| {
        let GhoTold { edge, pose, velocity, state: State { u, s, omega, v_t }, missed } = it;
        json!({
            "edge": edge,
            "pose": [pose.x, pose.y, pose.theta],
            "twist": [velocity.x, velocity.y, omega],
            "state": {"u": u, "s": s, "omega": omega, "vT": v_t},
            "missed": missed,
            "covariance": null,
            "probability": null,
        })
    };
    json!({"t": time, "method": "gho", "assumed": assumed, "hypotheses": told.iter().map(hypothesis).collect::<Vec<_>>()})
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::width::COLUMNS;

    #[test]
    fn estimates_and_corrections_are_read_from_words() {
        let Initial([u, s, omega, v_t]) = initial("90,-12.5").unwrap();
        assert!((u - PI / 2.0).abs() < 1e-12 && (s + 0.0125).abs() < 1e-12 && omega.abs() + v_t.abs() < 1e-12);
        assert!((initial("0,0,180,5").unwrap().0[2] - PI).abs() < 1e-12);
        for text in ["", "1", "1,2,3,4,5", "a,b"] {
            assert!(initial(text).is_err(), "{text}");
        }
        assert_eq!(correction("0.06,0").unwrap().0.map(f64::to_bits), [0.06, 0.0].map(f64::to_bits));
        assert!(correction("0,1").is_err() && correction("1").is_err());
    }

    #[test]
    fn lines_fit_a_terminal() {
        let widest: usize = WIDTHS.iter().sum();
        assert!(widest <= COLUMNS && legend().lines().all(|line| line.chars().count() <= COLUMNS));
    }
}
