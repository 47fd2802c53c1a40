//! What a command says of the samples that its answer rests on.

use std::process::ExitCode;

use palpate::finger::judge::Tally;
use serde_json::{Value, json};

/// Exit status where there is an answer, but samples behind it were no measurements or the device started anew.
pub(super) const EXIT_FAULTS: u8 = 3;

/// For programs.
pub(super) fn as_json(tally: &Tally) -> Value {
    let Tally { measured, missing, uncountable_gaps, saturated, stuck, settling, restarts } = tally;
    json!({
        "measured": measured, "missing": missing, "uncountable_gaps": uncountable_gaps, "saturated": saturated,
        "stuck": stuck, "settling": settling, "restarts": restarts,
    })
}

/// For people, where there is anything to say.
pub(super) fn tell(since: &str, tally: &Tally) {
    if !tally.is_whole() {
        note!("{since}: {tally}, of {} samples", tally.measured + tally.not_measured() + tally.missing);
    }
}

/// The exit status of an answer that rests on such samples. Missing ones widen its uncertainty and are no failure.
pub(super) fn status(tally: &Tally) -> ExitCode {
    if tally.has_faults() { ExitCode::from(EXIT_FAULTS) } else { ExitCode::SUCCESS }
}
