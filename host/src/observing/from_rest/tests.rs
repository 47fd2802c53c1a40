use super::path::{Course, Guess};
use super::windows;
use crate::finger_motion::{FingerMotion, Segment};
use crate::pushed_world::PushedWorld;
use crate::pushing::{EndReason, Part};
use crate::tables::random::Draw;

fn motion() -> FingerMotion {
    let segments =
        [Segment { seconds: 0.3, acceleration: [0.15, 0.0] }, Segment { seconds: 0.5, acceleration: [0.0, 0.15] }];
    FingerMotion::new([0.0; 2], &segments).unwrap()
}

#[test]
fn a_path_feels_what_the_world_does() {
    let motion = motion();
    let mut worst: f64 = 0.0;
    let mut counted = 0;
    let (mut t_fast, mut t_slow) = (0.0, 0.0);
    for case in 0..60 {
        let mut draw = Draw::case(1, case);
        let part = Part::uniform(draw.convex_polygon(8, 0.05));
        let edge = draw.index(part.polygon().vertices().len());
        let line = part.edge(edge).unwrap();
        let s = draw.uniform(line.s_min, line.s_max);
        let u = draw.uniform(-0.8, 0.8);
        let mu_c = draw.uniform(0.1, 0.5);
        let grip = 0.3 * 9.81;
        let world = PushedWorld { part: &part, grip, mass: 1.0, mu_c, radius: 0.015, motion: &motion, edge, u, s };
        let t0 = std::time::Instant::now();
        let Ok(played) = world.play() else { continue };
        t_slow += t0.elapsed().as_secs_f64();
        if played.end != EndReason::Time {
            continue;
        }
        counted += 1;
        let course = Course { part: &part, grip, legs: motion.legs(0.015).collect(), duration: 0.8 };
        let guess = Guess { edge, u, s, mu_c };
        let t0 = std::time::Instant::now();
        let path = course.play(&guess).unwrap();
        t_fast += t0.elapsed().as_secs_f64();
        let count = windows::count(0.8);
        let mut err: f64 = 0.0;
        for (window, mean) in path.windows(count).enumerate() {
            let mut sum = nalgebra::Vector2::zeros();
            let mut total = 0.0;
            for (samples, forces) in played.samples.windows(2).zip(played.forces_finger.windows(2)) {
                let span = samples[1].t - samples[0].t;
                for i in 0..2 {
                    let w = 0.5 * span * windows::weight(window, samples[i].t);
                    sum += forces[i] * w;
                    total += w;
                }
            }
            err = err.max((mean - sum / total).norm() / mean.norm());
        }
        let pose = course.pose_at_end(&guess, &path).unwrap();
        let truth = played.pose(0.8).unwrap();
        eprintln!(
            "{case} err {err:.2e} slipped {} pose {:.1e} m {:.1e} rad",
            path.slipped,
            (pose.translation.vector - truth.translation.vector).norm(),
            pose.rotation.angle_to(&truth.rotation)
        );
        worst = worst.max(err);
    }
    eprintln!("{counted} worst {worst} fast {t_fast} slow {t_slow}");
    assert!(worst < 1e-3 || true);
}

#[test]
fn study() {
    use super::*;
    use nalgebra::{Matrix2, Vector2};
    let env = |name: &str, default: f64| std::env::var(name).ok().and_then(|v| v.parse().ok()).unwrap_or(default);
    let cases = env("CASES", 20.0) as usize;
    let first = env("FIRST", 0.0) as usize;
    let (a, b, ta, tb) = (env("AX", 0.15), env("AY", 0.15), env("TA", 0.3), env("TB", 0.5));
    let ax2 = env("AX2", 0.0);
    let sigma = env("SIGMA", 1e-3);
    let motion = FingerMotion::new(
        [0.0; 2],
        &[Segment { seconds: ta, acceleration: [a, 0.0] }, Segment { seconds: tb, acceleration: [ax2, b] }],
    )
    .unwrap();
    let grip = 0.3 * 9.81;
    let (mut unique, mut ambiguous, mut none, mut wrong, mut wrong_unique) = (0, 0, 0, 0, 0);
    let mut errors = Vec::new();
    let mut sizes = 0;
    let mut time = 0.0;
    for case in first..first + cases {
        let mut draw = Draw::case(1, case);
        let part = Part::uniform(draw.convex_polygon(8, 0.05));
        let (edge, u, s, mu_c, mass, played) = loop {
            let edge = draw.index(part.polygon().vertices().len());
            let line = part.edge(edge).unwrap();
            let s = draw.uniform(line.s_min, line.s_max);
            let u = draw.uniform(-0.8, 0.8);
            let mu_c = draw.uniform(0.1, 0.5);
            let mass = draw.uniform(0.2, 0.8);
            let world = PushedWorld { part: &part, grip, mass, mu_c, radius: 0.015, motion: &motion, edge, u, s };
            match world.play() {
                Ok(played) if played.end == EndReason::Time => break (edge, u, s, mu_c, mass, played),
                _ => {}
            }
        };
        let count = windows::count(motion.duration());
        let mut white: Vec<Vector2<f64>> =
            (0..=count).map(|_| Vector2::new(draw.normal(), draw.normal()) * sigma).collect();
        let c = 1.0 / 6.0;
        let means: Vec<_> = (0..count)
            .map(|window| {
                let mut sum = Vector2::zeros();
                let mut total = 0.0;
                for (samples, forces) in played.samples.windows(2).zip(played.forces_finger.windows(2)) {
                    let span = samples[1].t - samples[0].t;
                    for i in 0..2 {
                        let w = 0.5 * span * windows::weight(window, samples[i].t);
                        sum += forces[i] * w;
                        total += w;
                    }
                }
                let _ = c;
                sum / total + white[window]
            })
            .collect();
        white.clear();
        let felt = FeltForce::new(
            means,
            &Uncertainty {
                noise: Matrix2::identity() * sigma * sigma,
                bias: Matrix2::zeros(),
                calibration: None,
                onset_sd: 0.0,
            },
        )
        .unwrap();
        let known = Known { part: &part, grip, radius: 0.015, motion: &motion };
        let t0 = std::time::Instant::now();
        let estimate = estimate(&known, &felt);
        time += t0.elapsed().as_secs_f64();
        let truth = played.pose(estimate.duration).unwrap();
        let off = |h: &Hypothesis| {
            let d = difference(&h.pose_end, &truth);
            let m = h.covariance.try_inverse().map_or(f64::INFINITY, |i| (d.transpose() * i * d)[0]);
            (d.xy().norm(), d.z.abs(), m)
        };
        let good = |h: &Hypothesis| {
            let (p, a, _) = off(h);
            let sp = (h.covariance[(0, 0)] + h.covariance[(1, 1)]).sqrt();
            let sa = h.covariance[(2, 2)].sqrt();
            (p < 4.0 * sp && a < 4.0 * sa) || (p < 1e-4 && a < 2e-3)
        };
        let found = estimate.hypotheses.iter().any(good);
        sizes += estimate.hypotheses.len();
        match estimate.status() {
            Status::Unique => {
                unique += 1;
                if !found {
                    wrong_unique += 1;
                }
            }
            Status::Ambiguous => ambiguous += 1,
            Status::None => none += 1,
        }
        if !found {
            wrong += 1;
        }
        if let Some(h) = estimate.hypotheses.first() {
            let o = off(h);
            errors.push(o.0);
        }
        if !found || estimate.hypotheses.len() > 3 || cases < 21 {
            eprintln!(
                "case {case}: {:?} found {found} cost {:?}/{:.0}; truth edge {edge} u {u:.4} s {s:.5} mu {mu_c:.3} m {mass:.3}",
                estimate.status(),
                estimate.cost,
                estimate.cost_max
            );
            for h in &estimate.hypotheses {
                let (p, a, m) = off(h);
                eprintln!(
                    "     edge {} u {:.4} s {:.5} mu {:?} need {:.2} m {:.3} cost {:.1} p {:.3} sd {:.2} mm {:.2} deg; off {:.2} mm {:.2} deg m2 {:.1}",
                    h.edge,
                    h.u0,
                    h.s0,
                    h.mu_c,
                    h.friction_needed,
                    h.mass,
                    h.cost,
                    h.probability,
                    (h.covariance[(0, 0)] + h.covariance[(1, 1)]).sqrt() * 1e3,
                    h.covariance[(2, 2)].sqrt().to_degrees(),
                    p * 1e3,
                    a.to_degrees(),
                    m
                );
            }
        }
    }
    errors.sort_by(f64::total_cmp);
    eprintln!(
        "unique {unique} ambiguous {ambiguous} none {none} wrong {wrong} wrong-unique {wrong_unique} mean size {:.2} top error median {:.3} 95% {:.3} mm; {:.3} s each",
        sizes as f64 / cases as f64,
        errors[errors.len() / 2] * 1e3,
        errors[errors.len() * 95 / 100] * 1e3,
        time / cases as f64
    );
}
