//! How poses that a push has told are printed: a line each for people, an object for programs.

use palpate::geometry::Pose;
use palpate::math::angle::wrap_angle;
use palpate::pushing::dynamics::Part;
use palpate::pushing::estimation::{Estimate, FromForce, Hypothesis, Status};
use serde_json::{Value, json};

use palpate::gravity::GRAVITY_ASSUMED;

/// Poses of one estimate that a person is shown; a program gets them all.
const SHOWN: usize = 5;

/// Above the lines of [`lines`].
pub(super) const HEADINGS: &str = concat!(
    "   felt         p  edge    centre of mass [mm]            turned [°]        contact on edge [mm]   mass  µ_c\n",
    "    [s]                    x       y       ±                        ±                                    [kg]",
);

/// Above the lines of an estimate: where the plane's friction is sought too, it has columns of its own.
pub(super) fn headings(estimate: &Estimate) -> String {
    let [first, second] = if estimate.mu_g_log_sd.is_some() { FRICTION_HEADINGS } else { ["", ""] };
    let mut lines = HEADINGS.lines();
    let mut with = |added: &str, width: usize| format!("{:width$}{added}", lines.next().unwrap_or_default());
    // The friction of the contact is the last column, of varying width.
    format!("{}\n{}", with(first, FRICTION_COLUMN).trim_end(), with(second, FRICTION_COLUMN).trim_end())
}

/// The columns of the plane's friction, and how uncertain the mass then is.
const FRICTION_HEADINGS: [&str; 2] = ["    µ of the plane    mass", "                ±      ± %"];

/// Column at which they begin, from 0.
const FRICTION_COLUMN: usize = 111;

/// An estimate for a person, a line for each pose.
pub(super) fn lines(part: &Part, estimate: &Estimate) -> Vec<String> {
    let at = format!("{:7.2}", estimate.time_end);
    match estimate.status() {
        Status::Unexplained => vec![format!("{at}   {}", none(estimate))],
        _ => {
            let shown = estimate.hypotheses.iter().take(SHOWN);
            let of_plane =
                |hypothesis: &Hypothesis| estimate.mu_g_log_sd.map_or_else(String::new, |_| plane(hypothesis));
            let of = |hypothesis: &Hypothesis| {
                let line = format!("{at}   {}", line(part, hypothesis));
                let added = of_plane(hypothesis);
                if added.is_empty() { line } else { format!("{line:FRICTION_COLUMN$}{added}") }
            };
            let mut lines: Vec<_> = shown.map(of).collect();
            let more = estimate.hypotheses.get(SHOWN..).unwrap_or_default();
            if !more.is_empty() {
                let probability: f64 = more.iter().map(|hypothesis| hypothesis.probability).sum();
                lines.push(format!("{at}   {probability:7.3}  and {} more", more.len()));
            }
            lines
        }
    }
}

fn none(estimate: &Estimate) -> String {
    let cost = estimate.fit.cost.map_or_else(String::new, |cost| {
        format!(": the best has a misfit of {cost:.0}, and chance gives at most {:.0}", estimate.fit.cost_max)
    });
    format!("no pose of this part explains the force{cost}")
}

fn line(part: &Part, hypothesis: &Hypothesis) -> String {
    let centre = hypothesis.pose_end.isometry() * part.centre_of_mass();
    let (distance_sd, angle_sd) = hypothesis.spread(part).unwrap_or((f64::NAN, f64::NAN));
    format!(
        "{:7.3}  {:>4} {:8.2} {:7.2} {:7.2} {:12.2} {:8.2} {:19.2} {:11.3}  {}",
        hypothesis.probability,
        hypothesis.edge,
        centre.x * 1e3,
        centre.y * 1e3,
        distance_sd * 1e3,
        hypothesis.pose_end.theta.to_degrees(),
        angle_sd.to_degrees(),
        hypothesis.end.s * 1e3,
        hypothesis.from_force.map_or(f64::NAN, |force| force.mass),
        hypothesis.from_force.as_ref().map_or_else(String::new, friction),
    )
}

/// The plane's friction and how uncertain the mass is with it.
fn plane(hypothesis: &Hypothesis) -> String {
    let mu = hypothesis.mu_g / GRAVITY_ASSUMED;
    let (mu_log_sd, force) = (hypothesis.mu_g_log_sd.unwrap_or(f64::NAN), hypothesis.from_force);
    format!("{mu:8.3} {:8.3} {:8.1}", mu * mu_log_sd, force.map_or(f64::NAN, |force| force.mass_log_sd) * 100.0)
}

fn friction(force: &FromForce) -> String {
    match force.mu_c {
        Some(mu_c) => format!("{mu_c:.3}"),
        // Rounded down, so that it is true.
        None => format!("≥ {:.3}", (force.friction_needed * 1e3).floor() * 1e-3),
    }
}

/// What an answer means, in a sentence or two.
pub(super) fn in_words(part: &Part, estimate: &Estimate) -> String {
    let mut words = match estimate.status() {
        Status::Unexplained => {
            "No pose of this part explains what was felt: is it this part, did the finger move as stated, was it at rest before?"
                .to_owned()
        }
        Status::Unique => "One pose explains what was felt.".to_owned(),
        Status::Ambiguous => format!(
            "{} poses explain what was felt and cannot be told apart by it; {}.",
            estimate.hypotheses.len(),
            apart(part, estimate)
        ),
    };
    words += &friction_in_words(estimate);
    if estimate.symmetry > 1 && !estimate.hypotheses.is_empty() {
        words += &format!(
            " The part looks the same in {} orientations: each pose stands for as many, turned by {:.0}° about the centre of mass.",
            estimate.symmetry,
            360.0 / f64::from(u32::try_from(estimate.symmetry).unwrap_or(u32::MAX))
        );
    }
    words
}

/// What is known now of the plane's friction, where it was not.
fn friction_in_words(estimate: &Estimate) -> String {
    let (Some(beforehand), Some(best)) = (estimate.mu_g_log_sd, estimate.hypotheses.first()) else {
        return String::new();
    };
    let (Some(force), Some(mu_g_log_sd)) = (best.from_force, best.mu_g_log_sd) else { return String::new() };
    if estimate.mass_and_friction_are_one() {
        return format!(
            " Mass and friction of the plane cannot be told apart by this push: mu times the mass is {:.4} kg within {}, each alone is known within {} only (one standard deviation); a finger that accelerates harder tells more.",
            best.mu_g / GRAVITY_ASSUMED * force.mass,
            share_or_factor(force.resistance_log_sd),
            share_or_factor(force.mass_log_sd)
        );
    }
    format!(
        " The plane's friction mu is {:.3} within {}; beforehand it was known within {} (one standard deviation).",
        best.mu_g / GRAVITY_ASSUMED,
        share_or_factor(mu_g_log_sd),
        share_or_factor(beforehand)
    )
}

/// The standard deviation of a logarithm as people write it.
fn share_or_factor(log_sd: f64) -> String {
    /// Up to here a share and a factor are the same for all purposes.
    const SHARE_MAX: f64 = 0.25;
    match log_sd <= SHARE_MAX {
        true => format!("{:.1} %", log_sd * 100.0),
        false => format!("a factor of {:.2}", log_sd.exp()),
    }
}

/// How far the listed poses lie apart.
fn apart(part: &Part, estimate: &Estimate) -> String {
    let [first, rest @ ..] = estimate.hypotheses.as_slice() else { return String::new() };
    let centre = |pose: &Pose| pose.isometry() * part.centre_of_mass();
    let distance = |other: &Hypothesis| (centre(&other.pose_end) - centre(&first.pose_end)).norm() * 1e3;
    let angle = |other: &Hypothesis| wrap_angle(other.pose_end.theta - first.pose_end.theta).abs().to_degrees();
    let most = |of: &dyn Fn(&Hypothesis) -> f64| rest.iter().map(of).fold(0.0, f64::max);
    format!(
        "they lie up to {:.1} mm and {:.1}° from the likeliest; a finger that turns aside, or a second push, may decide",
        most(&distance),
        most(&angle)
    )
}

/// An estimate for a program: SI, radians, the finger's axes.
pub(super) fn as_json(estimate: &Estimate) -> Value {
    let status = match estimate.status() {
        Status::Unique => "unique",
        Status::Ambiguous => "ambiguous",
        Status::Unexplained => "none",
    };
    json!({
        "t": estimate.time_end,
        "status": status,
        "symmetry": estimate.symmetry,
        "cost": estimate.fit.cost,
        "cost_max": estimate.fit.cost_max,
        "mass_and_friction_are_one": estimate.mass_and_friction_are_one(),
        "hypotheses": estimate.hypotheses.iter().map(hypothesis_as_json).collect::<Vec<_>>(),
    })
}

fn hypothesis_as_json(hypothesis: &Hypothesis) -> Value {
    let pose = |pose: &Pose| json!([pose.x, pose.y, wrap_angle(pose.theta)]);
    let covariance = hypothesis.covariance.map(|covariance| <[[f64; 3]; 3]>::from(covariance.transpose()));
    let force = hypothesis.from_force;
    json!({
        "edge": hypothesis.edge,
        "u0": hypothesis.start.u,
        "s0": hypothesis.start.s,
        "u_end": hypothesis.end.u,
        "s_end": hypothesis.end.s,
        "mu_c": force.and_then(|force| force.mu_c),
        "mu_c_sd": force.and_then(|force| force.mu_c_sd),
        "friction_needed": force.map(|force| force.friction_needed),
        "mass": force.map(|force| force.mass),
        "mass_log_sd": force.map(|force| force.mass_log_sd),
        "mu": hypothesis.mu_g / GRAVITY_ASSUMED,
        "mu_log_sd": hypothesis.mu_g_log_sd,
        "pose_start": pose(&hypothesis.pose_start),
        "pose_end": pose(&hypothesis.pose_end),
        "covariance": covariance,
        "cost": hypothesis.cost,
        "probability": hypothesis.probability,
    })
}
