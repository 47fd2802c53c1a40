//! Files of the project, and the reference cases that may lie beside it.

use std::path::Path;

use serde_json::Value;

/// The project's folder.
///
/// # Panics
/// Never: this package lies in it.
#[must_use]
pub fn folder() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("this package lies in the project's folder")
}

/// The reference cases `../shared/cases/<name>.jsonl`; `None`, said aloud, where they are absent: they are no part of
/// the project.
///
/// # Panics
/// If a line is not JSON.
#[must_use]
pub fn reference_cases(name: &str) -> Option<Vec<Value>> {
    let path = folder().join("../shared/cases").join(format!("{name}.jsonl"));
    let Ok(text) = std::fs::read_to_string(&path) else {
        eprintln!("NOT TESTED: the reference cases {} are absent", path.display());
        return None;
    };
    Some(text.lines().map(|line| serde_json::from_str(line).expect("a case is a line of JSON")).collect())
}
