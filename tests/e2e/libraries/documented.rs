//! The worked lines of `docs/SOLVE.md` that no file here is about.

use palpate_files::solve::KINDS;
use palpate_tests::project;
use serde_json::Value;

/// Kinds with their modes where it matters, and how near their numbers come on another processor, relative to 1 or to
/// themselves: rounding goes through an integration, and through minima of least squares, which are found to about the
/// root of rounding.
const KINDS_PRINTED: [(&str, Option<&str>, f64); 4] = [
    ("push", None, 1e-9),
    ("push", Some("quasi_static"), 1e-9),
    ("observe_push", None, 1e-6),
    ("inscription", None, 1e-7),
];

#[test]
fn worked_lines_are_answered_as_documented() {
    for (kind, mode, printed) in KINDS_PRINTED {
        let is_chosen = |line: &Value| line["problem"] == kind && mode.is_none_or(|mode| line["mode"] == mode);
        let [problem, documented] = project::documented(is_chosen);
        let answer = KINDS.solve(problem).unwrap();
        assert!(project::alike(&answer, &documented, printed), "{answer}");
    }
}
