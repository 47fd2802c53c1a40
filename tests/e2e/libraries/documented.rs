//! The worked lines of `docs/SOLVE.md` that no file here is about.

use palpate_files::solve::KINDS;
use palpate_tests::project;

/// Kinds, and how near their numbers come on another processor, relative to 1 or to themselves: rounding goes through
/// an integration, and through minima of least squares, which are found to about the root of rounding.
const KINDS_PRINTED: [(&str, f64); 3] = [("push", 1e-9), ("observe_push", 1e-6), ("inscription", 1e-7)];

#[test]
fn worked_lines_are_answered_as_documented() {
    for (kind, printed) in KINDS_PRINTED {
        let [problem, documented] = project::documented(|line| line["problem"] == kind);
        let answer = KINDS.solve(problem).unwrap();
        assert!(project::alike(&answer, &documented, printed), "{answer}");
    }
}
