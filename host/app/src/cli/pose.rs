//! How poses that a push has told are printed: a line each for people, an object for programs.

use palpate::geometry::Pose;
use palpate::math::angle::wrap_angle;
use palpate::pushing::dynamics::Part;
use palpate::pushing::estimation::from_rest::readings::ForceHypothesis;
use palpate::pushing::estimation::{Estimate, FromForce, Hypothesis, Status};
use serde_json::{Value, json};

use palpate::gravity::GRAVITY_ASSUMED;

use crate::width::folded;

/// Poses of one estimate that a person is shown; a program gets them all.
const SHOWN: usize = 5;

/// Widths of the columns: time, probability, edge, centre of mass and its error, turn and its error, place on the edge,
/// mass, friction at the finger, friction of the plane.
const WIDTHS: [usize; 12] = [5, 6, 5, 8, 8, 6, 8, 6, 7, 6, 7, 6];

/// Cells in their columns, with a blank between them at least.
pub(super) fn columns<S: AsRef<str>>(cells: &[S], widths: &[usize]) -> String {
    cells.iter().zip(widths).map(|(cell, width)| format!("{:>width$}", format!(" {}", cell.as_ref()))).collect()
}

fn row<S: AsRef<str>>(cells: &[S]) -> String {
    columns(cells, &WIDTHS)
}

/// Above the lines of [`lines`].
pub(super) fn headings() -> String {
    let names = ["felt", "p", "edge", "x", "y", "±", "turned", "±", "at", "mass", "µ_c", "µ"];
    let units = ["[s]", "", "", "[mm]", "[mm]", "[mm]", "[°]", "[°]", "[mm]", "[kg]"];
    format!("{}\n{}", row(&names), row(&units))
}

/// Below them: what the columns are.
pub(super) fn legend(part: &Part) -> String {
    let of_ellipse = if part.semi_axes().is_some() { "; on an ellipse the eccentric angle there" } else { "" };
    folded(&format!(
        "felt: up to this time since the push began. p: probability. edge: the one in contact, as in the part file, from 0. \
         x, y, turned: the part's centre of mass, and how far the part is turned. ±: one standard deviation, of the \
         distance and of the angle. at: where on its edge the contact is, counter-clockwise from where the centre of \
         mass stands over it{of_ellipse}. µ_c: friction at the finger, ≥ where nothing slipped. µ: friction of the plane.",
    ))
}

/// An estimate for a person, a line for each pose.
pub(super) fn lines(part: &Part, estimate: &Estimate) -> Vec<String> {
    let at = format!("{:.2}", estimate.time_end);
    if estimate.status() == Status::Unexplained {
        return vec![format!("{} {}", row(&[at]), none(estimate))];
    }
    let shown = estimate.hypotheses.iter().take(SHOWN);
    let mut lines: Vec<_> = shown.map(|hypothesis| line(&at, part, hypothesis)).collect();
    let more = estimate.hypotheses.get(SHOWN..).unwrap_or_default();
    if !more.is_empty() {
        let probability: f64 = more.iter().map(|hypothesis| hypothesis.probability).sum();
        lines.push(format!("{}  and {} more", row(&[at, format!("{probability:.3}")]), more.len()));
    }
    lines
}

/// What each reading of a push has told, a line for each pose.
pub(super) fn lines_of_readings(part: &Part, felt: f64, found: &[&ForceHypothesis]) -> Vec<String> {
    let at = format!("{felt:.2}");
    if found.is_empty() {
        return vec![format!("{} no pose explains it", row(&[at]))];
    }
    let line = |found: &&ForceHypothesis| {
        let told = if found.is_continuum { (f64::NAN, f64::NAN) } else { found.spread(part) };
        let (distance_sd, angle_sd) = told;
        let shown = ShownPose {
            probability: found.probability,
            edge: found.edge,
            pose: found.pose_end,
            distance_sd,
            angle_sd,
            s: found.end.s,
            mass: found.mass,
            mu_c: found.mu_c.map_or_else(String::new, |mu_c| format!("{mu_c:.3}")),
            mu_g: found.mu_g,
        };
        shown.line(&at, part)
    };
    found.iter().map(line).collect()
}

fn none(estimate: &Estimate) -> String {
    let cost = estimate.fit.cost.map_or_else(String::new, |cost| {
        format!(": the least misfit is {cost:.0}, chance gives at most {:.0}", estimate.fit.cost_max)
    });
    format!("no pose explains it{cost}")
}

fn line(at: &str, part: &Part, hypothesis: &Hypothesis) -> String {
    let (distance_sd, angle_sd) = hypothesis.spread(part).unwrap_or((f64::NAN, f64::NAN));
    let shown = ShownPose {
        probability: hypothesis.probability,
        edge: hypothesis.edge,
        pose: hypothesis.pose_end,
        distance_sd,
        angle_sd,
        s: hypothesis.end.s,
        mass: hypothesis.from_force.map_or(f64::NAN, |force| force.mass),
        mu_c: hypothesis.from_force.as_ref().map_or_else(String::new, friction),
        mu_g: hypothesis.mu_g,
    };
    shown.line(at, part)
}

/// What a person is told of a pose; SI units.
struct ShownPose {
    probability: f64,
    edge: usize,
    pose: Pose,
    distance_sd: f64,
    angle_sd: f64,
    s: f64,
    mass: f64,
    mu_c: String,
    mu_g: f64,
}

impl ShownPose {
    fn line(&self, at: &str, part: &Part) -> String {
        let centre = self.pose.isometry() * part.centre_of_mass();
        let is_round = part.semi_axes().is_some();
        let hundredths = |value: f64| format!("{value:.2}");
        let thousandths = |value: f64| format!("{value:.3}");
        row(&[
            at.to_owned(),
            thousandths(self.probability),
            if is_round { "–".to_owned() } else { self.edge.to_string() },
            hundredths(centre.x * 1e3),
            hundredths(centre.y * 1e3),
            deviation(self.distance_sd * 1e3),
            hundredths(wrap_angle(self.pose.theta).to_degrees()),
            deviation(self.angle_sd.to_degrees()),
            if is_round { format!("{:.1}°", self.s.to_degrees()) } else { hundredths(self.s * 1e3) },
            thousandths(self.mass),
            self.mu_c.clone(),
            thousandths(self.mu_g / GRAVITY_ASSUMED),
        ])
    }
}

/// A standard deviation; one of hundreds has no decimals worth a column.
pub(super) fn deviation(value: f64) -> String {
    if value.is_nan() {
        "–".to_owned()
    } else if value < 99.995 {
        format!("{value:.2}")
    } else {
        format!("{value:.0}")
    }
}

fn friction(force: &FromForce) -> String {
    match force.mu_c {
        Some(mu_c) => format!("{mu_c:.3}"),
        // Rounded down, so that it is true.
        None => format!("≥{:.3}", (force.friction_needed * 1e3).floor() * 1e-3),
    }
}

/// What an answer means, in a sentence or two.
pub(super) fn in_words(part: &Part, estimate: &Estimate) -> String {
    let mut words = match estimate.status() {
        Status::Unexplained => "No pose of this part explains what was felt.".to_owned(),
        Status::Unique => "One pose explains what was felt.".to_owned(),
        Status::Ambiguous if estimate.hypotheses.len() == 1 => {
            "One pose was found that explains what was felt, but another may, too: \
             nobody told how the part presses on the plane."
                .to_owned()
        }
        Status::Ambiguous if estimate.hypotheses[0].probability >= NEARLY_CERTAIN => format!(
            "One pose explains what was felt far best; {} more cannot be excluded, with a probability of {:.1e} together.",
            estimate.hypotheses.len() - 1,
            estimate.hypotheses[1..].iter().map(|other| other.probability).sum::<f64>()
        ),
        Status::Ambiguous => format!(
            "{} poses explain what was felt and cannot be told apart by it; {}.",
            estimate.hypotheses.len(),
            apart(part, estimate)
        ),
    };
    words += &friction_in_words(estimate);
    words += &mass_in_doubt(part, estimate);
    if estimate.hypotheses.iter().any(|hypothesis| hypothesis.covariance.is_none()) {
        words += " The part is a disk, and how it is turned cannot be felt: the angle told stands for all.";
    }
    if estimate.symmetry > 1 && !estimate.hypotheses.is_empty() {
        words += &format!(
            " The part looks the same in {} orientations: each pose stands for as many, turned by {:.0}° about the centre of mass.",
            estimate.symmetry,
            360.0 / f64::from(u32::try_from(estimate.symmetry).unwrap_or(u32::MAX))
        );
    }
    folded(&words)
}

/// Poses less likely than the rest of this are no choice: printed, they have a probability of 0.000.
pub(super) const NEARLY_CERTAIN: f64 = 0.9995;

/// Density of steel, kg/m³.
const STEEL: f64 = 7850.0;

/// Nobody pushes a part that is as heavy as this thickness of steel, m.
const THICK_STEEL_M: f64 = 0.1;

/// Asks about the unit of force where the mass found is beyond what such a part can have.
fn mass_in_doubt(part: &Part, estimate: &Estimate) -> String {
    let mass = estimate.hypotheses.first().and_then(|best| best.from_force).map(|force| force.mass);
    let area = part.polygon().area();
    match mass.map(|mass| (mass, mass / area / STEEL)) {
        Some((mass, thick)) if thick > THICK_STEEL_M => format!(
            " A mass of {mass:.1} kg on {:.1} cm² is that of {:.0} cm of steel: are the forces in newtons?",
            area * 1e4,
            thick * 100.0
        ),
        _ => String::new(),
    }
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
        " The plane's friction mu is {:.3} within {}, the mass {:.3} kg within {}; beforehand mu was known within {} (one standard deviation each).",
        best.mu_g / GRAVITY_ASSUMED,
        share_or_factor(mu_g_log_sd),
        force.mass,
        share_or_factor(force.mass_log_sd),
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

/// For a program, as `palpate solve` has it.
pub(super) fn status(status: Status) -> &'static str {
    match status {
        Status::Unique => "unique",
        Status::Ambiguous => "ambiguous",
        Status::Unexplained => "none",
    }
}

/// An estimate for a program: SI, radians, the finger's axes.
pub(super) fn as_json(estimate: &Estimate) -> Value {
    json!({
        "t": estimate.time_end,
        "status": status(estimate.status()),
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

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix3, Point2, Vector2};
    use palpate::geometry::SimplePolygon;
    use palpate::pushing::dynamics::{ContactLaw, ContactMode, State};
    use palpate::pushing::estimation::Fit;

    use super::*;
    use crate::width::COLUMNS;

    /// 60 by 40 mm.
    fn part() -> Part {
        let vertices = [[0.0, 0.0], [0.06, 0.0], [0.06, 0.04], [0.0, 0.04]].map(Point2::from).to_vec();
        Part::uniform(SimplePolygon::new(vertices).unwrap())
    }

    fn hypothesis(probability: f64, mass: f64) -> Hypothesis {
        let state = State { u: 0.1, s: -0.01812, omega: 0.0, v_t: 0.0 };
        let pose = Pose { x: -0.12345, y: 1.23456, theta: -3.1 };
        Hypothesis {
            edge: 12,
            side: 12,
            start: state,
            contact_start: ContactMode::Rolling,
            end: state,
            contact_end: ContactMode::Rolling,
            law: ContactLaw::Rolling { friction: None },
            pose_start: pose,
            pose_end: pose,
            velocity_end: Vector2::zeros(),
            covariance: Some(Matrix3::identity() * 10.0),
            state_covariance: None,
            mu_g: 0.25 * GRAVITY_ASSUMED,
            mu_g_log_sd: Some(0.19),
            from_force: Some(FromForce {
                mass,
                mass_log_sd: 0.2,
                resistance_log_sd: 0.19,
                mu_c: None,
                mu_c_sd: None,
                friction_needed: 0.1234,
            }),
            cost: 10.0,
            probability,
        }
    }

    fn estimate(hypotheses: Vec<Hypothesis>) -> Estimate {
        let fit = Fit { cost: Some(123_456.7), degrees_of_freedom: 20, cost_max: 45.3 };
        Estimate { hypotheses, mu_g_log_sd: Some(0.2), symmetry: 2, ..Estimate::unexplained(fit, 10.25) }
    }

    #[test]
    fn poses_and_what_is_said_of_them_fit_a_terminal() {
        let several = estimate((0..4).flat_map(|_| [hypothesis(0.3, 12.345), hypothesis(0.2, 0.2)]).collect());
        for estimate in [&several, &estimate(vec![])] {
            let mut told = lines(&part(), estimate);
            told.extend([headings(), legend(&part()), in_words(&part(), estimate)]);
            for line in told.iter().flat_map(|text| text.lines()) {
                assert!(line.chars().count() <= COLUMNS, "{} columns: {line}", line.chars().count());
            }
        }
        let first = lines(&part(), &several).remove(0);
        let cells: Vec<_> = first.split_whitespace().collect();
        assert_eq!(cells.len(), WIDTHS.len(), "{first}");
        assert_eq!([cells[2], cells[9], cells[10], cells[11]], ["12", "12.345", "≥0.123", "0.250"], "{first}");
    }

    /// Printed, the others have a probability of 0.000: they are no choice.
    #[test]
    fn a_pose_that_is_all_but_certain_is_not_called_one_of_two() {
        let said =
            in_words(&part(), &estimate(vec![hypothesis(0.9998, 0.2), hypothesis(0.0002, 0.2)])).replace('\n', " ");
        assert!(
            said.starts_with("One pose explains what was felt far best; 1 more") && said.contains("2.0e-4"),
            "{said}"
        );
        let said = in_words(&part(), &estimate(vec![hypothesis(0.6, 0.2), hypothesis(0.4, 0.2)]));
        assert!(said.starts_with("2 poses explain"), "{said}");
    }

    #[test]
    fn a_pose_beside_which_others_are_not_excluded_is_not_called_the_one() {
        let one = estimate(vec![hypothesis(1.0, 0.2)]);
        assert_eq!(as_json(&one)["status"], "unique");
        let one = Estimate { can_exclude_others: false, ..one };
        let said = in_words(&part(), &one).replace('\n', " ");
        assert!(said.starts_with("One pose was found that explains what was felt, but another may, too"), "{said}");
        assert_eq!(as_json(&one)["status"], "ambiguous");
    }

    #[test]
    fn a_mass_that_no_such_part_has_asks_for_the_unit_of_force() {
        let said = in_words(&part(), &estimate(vec![hypothesis(1.0, 20.4)])).replace('\n', " ");
        assert!(said.contains("20.4 kg on 24.0 cm² is that of 108 cm of steel: are the forces in newtons?"), "{said}");
        assert!(!in_words(&part(), &estimate(vec![hypothesis(1.0, 0.2)])).contains("steel"));
    }
}
