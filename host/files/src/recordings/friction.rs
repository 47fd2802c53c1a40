//! Friction between finger and part from the pushes of a log, and what it leaves open of the contact's direction.
//!
//! Of a push with poses before and after it is known how far the finger slid along the edge; those that slid tell the
//! friction ([`palpate::finger::contact::friction`]). It is one more thing that the stated intervals must hold, so they
//! are widened by it.
//!
//! Units: SI. Errors: [`FrictionUnknown`] where too few pushes slid, or nothing is known of the part.

use std::f64::consts::PI;

use palpate::finger::contact::friction::{FrictionUnknown, PushAlongEdge, SlidingFriction, sliding_friction};

use super::session::{COVERAGE, RecordingReport, within_stated};

/// The friction that the pushes of a log tell, each compared with the part's edge.
///
/// # Errors
/// [`FrictionUnknown`] if too few slid along a known edge.
pub fn of_reports(reports: &[RecordingReport]) -> Result<SlidingFriction, FrictionUnknown> {
    let along = reports.iter().filter_map(|report| {
        let angles = report.series.iter().filter_map(|row| row.touch?.angle_to_normal).collect();
        Some(PushAlongEdge { slip: report.edge?.slip?, angles })
    });
    sliding_friction(&along.collect::<Vec<_>>(), COVERAGE)
}

/// Widens the intervals of reports that were made without friction, by `atan(mu)`, and counts anew what they hold.
pub fn widen(reports: &mut [RecordingReport], mu: f64) {
    for report in reports {
        for touch in report.series.iter_mut().filter_map(|row| row.touch.as_mut()) {
            touch.u_half_width = (touch.u_half_width + mu.atan()).min(PI);
        }
        if let Some(edge) = &mut report.edge {
            edge.within_stated = within_stated(&report.series);
        }
    }
}

#[cfg(test)]
mod tests {
    use palpate::finger::contact::ContactSettings;

    use super::super::mlab;
    use super::super::part::RecordedPart;
    use super::super::session::{MLAB_TOOL_FROM_SENSOR, RecordingOptions, of_log};
    use super::super::synthetic::{PushSpec, log, session};
    use super::*;

    const TRIANGLE: &str = "3\n0 0 0\n150 0 0\n0 150 0\n50\n";
    /// What the made-up forces are turned by, rad.
    const TURN: f64 = 0.4;
    /// Noise of 4 mN in 3 N, and a part that is taken to move evenly.
    const MU_ERROR: f64 = 0.01;

    /// Pushes that slide along the edge by so many mm.
    fn reports(slide: f64, friction: f64, contact_friction: f64) -> Vec<RecordingReport> {
        let pushes: Vec<_> = session(8).into_iter().map(|push| PushSpec { slide, friction, ..push }).collect();
        let options = RecordingOptions {
            settings: ContactSettings { contact_friction, ..ContactSettings::default() },
            finger_from_sensor: MLAB_TOOL_FROM_SENSOR,
            part: Some(RecordedPart::parse(TRIANGLE).unwrap()),
            ..RecordingOptions::default()
        };
        of_log(&mlab::parse(&log(&pushes)).unwrap(), &options).unwrap()
    }

    #[test]
    fn pushes_that_slide_tell_the_friction() {
        // The tip goes on counter-clockwise (+x on the lower edge), and friction takes the part with it: clockwise of
        // the inward normal.
        for (slide, friction) in [(6.0, -TURN), (-6.0, TURN)] {
            let found = of_reports(&reports(slide, friction, 0.0)).unwrap();
            assert_eq!(found.slid, 8);
            assert!((found.mu_c.value - TURN.tan()).abs() < MU_ERROR, "{found:?}");
            assert!((found.cone() - TURN.tan()).abs() < 2.0 * MU_ERROR, "{found:?}");
            let slip = reports(slide, friction, 0.0)[0].edge.unwrap().slip.unwrap();
            // From the onset on, a quarter of the push is over.
            assert!((slip - 1e-3 * slide * 0.75).abs() < 0.1e-3, "{slip}");
        }
    }

    #[test]
    fn pushes_that_stick_or_slide_against_their_friction_do_not() {
        assert_eq!(of_reports(&reports(0.0, TURN, 0.0)), Err(FrictionUnknown { slid: 0 }));
        assert_eq!(of_reports(&reports(6.0, TURN, 0.0)), Err(FrictionUnknown { slid: 0 }));
    }

    #[test]
    fn widened_intervals_are_those_that_the_friction_would_have_given() {
        let told = reports(6.0, -TURN, 0.5);
        let mut widened = reports(6.0, -TURN, 0.0);
        assert!(widened.iter().all(|report| report.edge.unwrap().within_stated < report.edge.unwrap().samples / 10));
        widen(&mut widened, 0.5);
        for (told, widened) in told.iter().zip(&widened) {
            assert_eq!(told.edge, widened.edge);
            let widths = |report: &RecordingReport| {
                report.series.iter().filter_map(|row| Some(row.touch?.u_half_width)).collect::<Vec<_>>()
            };
            assert!(widths(told).iter().zip(widths(widened)).all(|(a, b)| (a - b).abs() < 1e-12));
        }
        let edge = widened[0].edge.unwrap();
        assert_eq!(edge.within_stated, edge.samples);
    }
}
