//! The plan of a calibration as a file. Errors: [`PlanFileError`] with the place in the text or the value that cannot
//! be.

use palpate::finger::calibration::plan::{CalibrationPlan, PlanError};

/// Why a text is no plan.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PlanFileError {
    /// Not TOML, or not the keys of a plan; the message shows the place.
    #[error("not a plan: {0}")]
    Text(String),
    /// A value that cannot be.
    #[error(transparent)]
    Plan(#[from] PlanError),
}

/// Reads a plan file.
///
/// # Errors
/// [`PlanFileError`].
pub fn from_toml(text: &str) -> Result<CalibrationPlan, PlanFileError> {
    let plan: CalibrationPlan = toml::from_str(text).map_err(|error| PlanFileError::Text(error.to_string()))?;
    plan.check()?;
    Ok(plan)
}

#[cfg(test)]
mod tests {
    use palpate::finger::calibration::Load;
    use palpate::finger::calibration::plan::{PlannedContact, Step};

    use super::*;

    #[test]
    fn a_short_file_is_a_whole_plan() {
        let text =
            "format = 1\n[[contact]]\nangle_deg = 0\nload = \"2 N\"\n[[contact]]\nangle_deg = 45.5\nload = \"same\"\n";
        let plan = from_toml(text).unwrap();
        assert_eq!(plan.contacts[0], PlannedContact { angle_deg: 0.0, load: Load::Newtons(2.0) });
        assert_eq!(plan.steps().len(), 4);
        assert_eq!(plan.steps()[2], Step::Tare { angle_deg: Some(45.5) });
        assert_eq!(from_toml(&toml::to_string(&plan).unwrap()).unwrap(), plan);
    }

    #[test]
    fn bad_plans_are_refused_by_name() {
        let good = "format = 1\n[[contact]]\nangle_deg = 0\nload = \"2 N\"\n";
        assert_eq!(
            from_toml(&good.replace("format = 1", "format = 2")),
            Err(PlanFileError::Plan(PlanError::Format(2)))
        );
        assert_eq!(from_toml("format = 1\ncontact = []"), Err(PlanFileError::Plan(PlanError::Contacts(0))));
        for (from, to, word) in [
            ("angle_deg = 0", "angle_deg = nan", "contact 1"),
            ("2 N", "2 stone", "2 stone"),
            ("format = 1", "format = 1\nangle_sigma_deg = -1", "angle_sigma_deg"),
            ("format = 1", "format = 1\nheld_back_every = 1", "held_back_every"),
            ("format = 1", "format = 1\ntypo = 1", "typo"),
        ] {
            let error = from_toml(&good.replace(from, to)).unwrap_err();
            assert!(error.to_string().contains(word), "{error}");
        }
    }
}
