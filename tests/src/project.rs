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

/// The first problem that `docs/SOLVE.md` works out and that is chosen, and its answer there.
///
/// # Panics
/// If there is none.
#[must_use]
pub fn documented(chosen: impl Fn(&Value) -> bool) -> [Value; 2] {
    let page = std::fs::read_to_string(folder().join("docs/SOLVE.md")).expect("the page is part of the project");
    let mut lines = page.lines().filter_map(|line| serde_json::from_str::<Value>(line).ok());
    let problem = lines.find(|line| chosen(line)).expect("the page works out such a problem");
    let answer = lines.find(|line| line["problem"] == problem["problem"]).expect("the page tells its answer");
    [problem, answer]
}

/// Whether two answers are the same but for the last digits of numbers, which differ from processor to processor: by at
/// most `printed`, relative to 1 or to themselves.
#[must_use]
pub fn alike(a: &Value, b: &Value, printed: f64) -> bool {
    match (a, b) {
        (Value::Number(a), Value::Number(b)) => {
            let pair = a.as_f64().zip(b.as_f64());
            pair.is_some_and(|(a, b)| (a - b).abs() <= printed * a.abs().max(1.0))
        }
        (Value::Array(a), Value::Array(b)) => a.len() == b.len() && a.iter().zip(b).all(|(a, b)| alike(a, b, printed)),
        (Value::Object(a), Value::Object(b)) => {
            a.len() == b.len() && a.iter().all(|(key, a)| b.get(key).is_some_and(|b| alike(a, b, printed)))
        }
        _ => a == b,
    }
}

/// Whether two texts are the same but for numbers that are `near`, each as it is written.
#[must_use]
pub fn texts_alike(a: &str, b: &str, near: impl Fn(&str, &str) -> bool) -> bool {
    let is_numeric = |c: char| c.is_ascii_digit() || c == '.' || c == '-';
    let tokens = |text: &str| -> Vec<(bool, String)> {
        let mut tokens: Vec<(bool, String)> = Vec::new();
        for c in text.chars() {
            match tokens.last_mut() {
                Some((numeric, token)) if *numeric == is_numeric(c) => token.push(c),
                _ => tokens.push((is_numeric(c), c.to_string())),
            }
        }
        tokens
    };
    let (a, b) = (tokens(a), tokens(b));
    a.len() == b.len()
        && a.iter().zip(&b).all(|((kind, a), (other, b))| kind == other && (a == b || *kind && near(a, b)))
}
