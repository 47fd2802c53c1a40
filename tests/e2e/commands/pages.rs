//! The pages a person reads: what they mark up, where they lead, that the files and names they speak of are there, and
//! that the index of the thesis is whole and true.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use palpate_tests::project::folder;

fn pages() -> Vec<(PathBuf, String)> {
    let folders = [
        ".",
        "docs",
        "docs/tutorial",
        "calibration",
        "firmware/board",
        "firmware/core",
        "firmware/usb",
        "shared",
        "host/science",
        "host/device",
        "host/files",
        "host/app",
    ]
    .map(|name| folder().join(name));
    let files = folders.iter().flat_map(|folder| std::fs::read_dir(folder).unwrap()).map(|entry| entry.unwrap().path());
    let pages: Vec<_> = files
        .filter(|path| path.extension().is_some_and(|extension| extension == "md"))
        .map(|path| (path.clone(), std::fs::read_to_string(path).unwrap()))
        .collect();
    assert!(pages.len() >= 12, "{} pages", pages.len());
    pages
}

#[test]
fn every_block_of_code_ends() {
    for (path, text) in pages() {
        let fences = text.lines().filter(|line| line.trim_start().starts_with("```")).count();
        assert!(fences.is_multiple_of(2), "{}: {fences} fences", path.display());
    }
}

#[test]
fn links_lead_to_files_and_headings_that_are_there() {
    let mut followed = 0;
    for (path, text) in pages() {
        let links = text.split("](").skip(1).filter_map(|rest| rest.split_once(')')).map(|(link, _)| link);
        for link in links.filter(|link| !link.contains("://")) {
            let (file, heading) = link.split_once('#').unwrap_or((link, ""));
            let target = if file.is_empty() { path.clone() } else { path.parent().unwrap().join(file) };
            assert!(target.exists(), "{}: {link}", path.display());
            if !heading.is_empty() {
                let page = std::fs::read_to_string(&target).unwrap();
                let headings: Vec<String> = page.lines().filter(|line| line.starts_with('#')).map(anchor).collect();
                assert!(headings.iter().any(|anchor| anchor == heading), "{}: {link}: {headings:?}", path.display());
            }
            followed += 1;
        }
    }
    assert!(followed > 10, "{followed} links");
}

/// What a heading is called in a link.
fn anchor(heading: &str) -> String {
    let plain = heading.trim_start_matches('#').trim().to_lowercase();
    let kept = plain.chars().filter(|c| c.is_alphanumeric() || matches!(c, ' ' | '-' | '_'));
    kept.map(|c| if c == ' ' { '-' } else { c }).collect()
}

/// The page that holds the index of the thesis.
const INDEX_PAGE: &str = "docs/NOTATION.md";

/// What a chapter or appendix of the thesis numbers: how many equations, figures and tables, each from 1 on. Algorithms
/// and statements are counted through the whole thesis: the first and last of each here, both 0 for none.
struct Chapter {
    label: &'static str,
    equations: usize,
    figures: usize,
    tables: usize,
    algorithms: [usize; 2],
    statements: [usize; 2],
}

/// A chapter without algorithms and statements.
const fn plain(label: &'static str, equations: usize, figures: usize, tables: usize) -> Chapter {
    Chapter { label, equations, figures, tables, algorithms: [0; 2], statements: [0; 2] }
}

const fn with(chapter: Chapter, algorithms: [usize; 2], statements: [usize; 2]) -> Chapter {
    Chapter { algorithms, statements, ..chapter }
}

/// Source: Y.-B. Jia's thesis (CMU-RI-TR-97-50), counted in its text.
const CHAPTERS: [Chapter; 13] = [
    plain("1", 0, 2, 0),
    with(plain("2", 0, 5, 3), [1, 2], [1, 3]),
    with(plain("3", 0, 6, 2), [0; 2], [4, 12]),
    with(plain("4", 10, 1, 0), [0; 2], [13, 16]),
    with(plain("5", 43, 6, 0), [0; 2], [17, 23]),
    plain("6", 0, 8, 3),
    with(plain("7", 34, 3, 0), [0; 2], [24, 32]),
    plain("8", 0, 0, 0),
    plain("A", 0, 1, 0),
    with(plain("B", 0, 1, 0), [0; 2], [33, 34]),
    plain("C", 1, 1, 0),
    plain("D", 0, 0, 0),
    with(plain("E", 1, 0, 0), [0; 2], [35, 35]),
];

/// What statement 1, 2, … of the thesis is called: they share one count.
const STATEMENTS: [&str; 35] = [
    "Claim",
    "Theorem",
    "Corollary",
    "Lemma",
    "Theorem",
    "Theorem",
    "Corollary",
    "Lemma",
    "Theorem",
    "Lemma",
    "Lemma",
    "Theorem",
    "Theorem",
    "Theorem",
    "Theorem",
    "Theorem",
    "Theorem",
    "Corollary",
    "Theorem",
    "Proposition",
    "Theorem",
    "Proposition",
    "Theorem",
    "Theorem",
    "Proposition",
    "Lemma",
    "Lemma",
    "Proposition",
    "Lemma",
    "Lemma",
    "Proposition",
    "Theorem",
    "Lemma",
    "Theorem",
    "Claim",
];

/// One row of the index.
struct Row {
    /// In the page, from 1 on.
    line: usize,
    /// Of the chapter or appendix.
    label: String,
    number: String,
    place: String,
}

/// The rows of the index, without headings.
fn index() -> Vec<Row> {
    let page = std::fs::read_to_string(folder().join(INDEX_PAGE)).unwrap();
    let (mut inside, mut label, mut rows) = (false, String::new(), Vec::new());
    for (line, text) in page.lines().enumerate().map(|(at, text)| (at + 1, text)) {
        if text.starts_with("## ") {
            inside = text == "## Index of the thesis";
        }
        if let Some(heading) = text.strip_prefix("### ") {
            label = heading.split([' ', ':']).nth(1).unwrap_or_default().to_owned();
        }
        if inside && text.starts_with("| ") && !text.starts_with("| number |") {
            let cells: Vec<_> = text.trim_matches('|').split('|').map(str::trim).collect();
            assert_eq!(cells.len(), 3, "{INDEX_PAGE}:{line}: a row has a number, what it says and where: {text}");
            rows.push(Row { line, label: label.clone(), number: cells[0].to_owned(), place: cells[2].to_owned() });
        }
    }
    assert!(rows.len() > 150, "{INDEX_PAGE}: {} rows in the index", rows.len());
    rows
}

/// The numbers of a chapter, kind by kind.
fn wanted(chapter: &Chapter) -> Vec<Vec<String>> {
    let label = chapter.label;
    let numbered = |kind: &str, count: usize| (1..=count).map(|n| format!("{kind} {label}.{n}")).collect::<Vec<_>>();
    let through = |[first, last]: [usize; 2]| (first..=last).filter(|n| *n > 0);
    let equations = (1..=chapter.equations).map(|n| format!("({label}.{n})")).collect();
    let algorithms = through(chapter.algorithms).map(|n| format!("Algorithm {n}")).collect();
    let statements = through(chapter.statements).map(|n| format!("{} {n}", STATEMENTS[n - 1])).collect();
    vec![equations, numbered("Figure", chapter.figures), numbered("Table", chapter.tables), algorithms, statements]
}

/// What kind of number it is, in the order of [`wanted`]; none for what the thesis leaves unnumbered.
fn kind(number: &str) -> Option<usize> {
    match number.split(' ').next()? {
        equation if equation.starts_with('(') => Some(0),
        "Figure" => Some(1),
        "Table" => Some(2),
        "Algorithm" => Some(3),
        "Appendix" => None,
        section if section.starts_with('§') => None,
        _ => Some(4),
    }
}

#[test]
fn the_index_has_every_number_of_the_thesis_once() {
    let rows = index();
    let mut faults = Vec::new();
    for row in &rows {
        if !CHAPTERS.iter().any(|chapter| chapter.label == row.label) {
            faults.push(format!("{INDEX_PAGE}:{}: got chapter {:?}, wanted one of the thesis", row.line, row.label));
        }
    }
    for chapter in &CHAPTERS {
        for (of, wanted) in wanted(chapter).into_iter().enumerate() {
            let here = |row: &&Row| row.label == chapter.label && kind(&row.number) == Some(of);
            let got: Vec<&Row> = rows.iter().filter(here).collect();
            let differs = (0..got.len().max(wanted.len()))
                .find(|&i| got.get(i).map(|row| row.number.as_str()) != wanted.get(i).map(String::as_str));
            let Some(first) = differs else { continue };
            let line = got.get(first).or(got.last()).map_or(0, |row| row.line);
            let [got, wanted] = [got.get(first).map(|row| &row.number), wanted.get(first)]
                .map(|number| number.map_or("nothing more", String::as_str));
            faults.push(format!("{INDEX_PAGE}:{line}: chapter {}: got {got}, wanted {wanted}", chapter.label));
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

/// What stands between backticks.
fn marked(text: &str) -> impl Iterator<Item = &str> {
    text.split('`').skip(1).step_by(2)
}

/// Whether a source file defines a name. Comments do not count.
fn defines(source: &str, name: &str) -> bool {
    const KINDS: [&str; 8] = ["fn", "struct", "enum", "trait", "type", "const", "static", "mod"];
    let code = source.lines().map(str::trim_start).filter(|line| !line.starts_with("//"));
    let mut words = code.map(|line| line.split(|c: char| !c.is_alphanumeric() && c != '_').collect::<Vec<_>>());
    words.any(|words| words.windows(2).any(|pair| KINDS.contains(&pair[0]) && pair[1] == name))
}

#[test]
fn what_the_notation_names_is_there() {
    let page = std::fs::read_to_string(folder().join(INDEX_PAGE)).unwrap();
    let (mut places, mut faults) = (0, Vec::new());
    for (line, text) in page.lines().enumerate().map(|(at, text)| (at + 1, text)) {
        // `path/to/folder/`, `path/to/file.rs` or `path/to/file.rs::name`.
        for place in marked(text).filter(|place| place.ends_with('/')) {
            if !folder().join(place).is_dir() {
                faults.push(format!("{INDEX_PAGE}:{line}: got {place}, wanted a folder"));
            }
        }
        for place in marked(text).filter(|place| place.contains('/') && place.contains(".rs")) {
            places += 1;
            let (file, name) = place.split_once("::").map_or((place, None), |(file, name)| (file, Some(name)));
            match (std::fs::read_to_string(folder().join(file)), name) {
                (Err(error), _) => faults.push(format!("{INDEX_PAGE}:{line}: got {file}: {error}, wanted a file")),
                (Ok(source), Some(name)) if !defines(&source, name) => {
                    faults.push(format!("{INDEX_PAGE}:{line}: got no {name} in {file}, wanted its definition"));
                }
                _ => {}
            }
        }
    }
    assert!(places > 200, "{INDEX_PAGE}: {places} places");
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

/// Everything in the project's folder, as `folder/file` and `folder/folder/`, without what is built.
fn tree() -> Vec<String> {
    let (mut found, mut open) = (Vec::new(), vec![folder().to_path_buf()]);
    while let Some(inside) = open.pop() {
        for entry in std::fs::read_dir(inside).unwrap().map(Result::unwrap) {
            let path = entry.path();
            let name = path.strip_prefix(folder()).unwrap().to_string_lossy().replace('\\', "/");
            if entry.file_name() == "target" || entry.file_name() == ".git" {
                continue;
            }
            if entry.file_type().unwrap().is_dir() {
                found.push(format!("{name}/"));
                open.push(path);
            } else {
                found.push(name);
            }
        }
    }
    found
}

/// What a mark of a page says of the tree.
#[derive(Debug, PartialEq)]
enum Named<'a> {
    /// A path from the project's folder, or from the page's.
    From(&'a str),
    /// The end of a path: `math/`, `solve/fields.rs`.
    End(&'a str),
}

/// Endings of files that a page may name without their folder.
const ENDINGS: [&str; 6] = [".rs", ".md", ".toml", ".svg", ".lock", ".x"];

/// The paths that a mark names, `roots` being the folders right in the project's. Commands name paths from there alone.
fn named<'a>(mark: &'a str, roots: &[String]) -> Vec<Named<'a>> {
    let is_plain = |word: &str| word.chars().all(|c| c.is_alphanumeric() || "._-/<>".contains(c));
    let path = |word: &'a str| {
        let word = word.split_once("::").map_or(word, |(file, _)| file);
        // `calibration/<finger>/`, `cli/NAME.rs`: as far as it is not left open.
        let left_open = word.find('<').or_else(|| word.find("NAME"));
        let closed = left_open.map_or(word, |end| &word[..word[..end].rfind('/').map_or(0, |slash| slash + 1)]);
        if closed.is_empty() || !is_plain(word) {
            None
        } else if roots.iter().any(|root| closed.starts_with(root.as_str())) {
            Some(Named::From(closed))
        } else {
            let is_end = closed.ends_with('/') || ENDINGS.iter().any(|ending| closed.ends_with(ending));
            // `.toml` alone is an ending, not a file.
            (is_end && !closed.starts_with(['.', '/']) && !mark.contains(' ')).then_some(Named::End(closed))
        }
    };
    mark.split(' ').filter_map(path).collect()
}

/// The present of a page: of the changelog what is not released yet, and what stands behind an arrow there.
fn present<'a>(path: &Path, text: &'a str) -> Vec<(usize, &'a str)> {
    let lines = text.lines().enumerate().map(|(at, line)| (at + 1, line));
    if !path.ends_with("CHANGELOG.md") {
        return lines.collect();
    }
    let headings = |line: &str| line.starts_with("## ");
    let unreleased = lines.skip_while(|(_, line)| !headings(line)).enumerate();
    let unreleased = unreleased.take_while(|(place, (_, line))| *place == 0 || !headings(line)).map(|(_, line)| line);
    unreleased.map(|(at, line)| (at, line.rsplit('→').next().unwrap_or(line))).collect()
}

#[test]
fn paths_that_pages_name_are_there() {
    let tree = tree();
    let roots: Vec<_> = tree.iter().filter(|name| name.find('/') == Some(name.len() - 1)).cloned().collect();
    assert!(roots.iter().any(|root| root == "docs/"), "{roots:?}");
    let (mut paths, mut faults) = (0, Vec::new());
    for (path, text) in pages() {
        for (line, text) in present(&path, &text) {
            for named in marked(text).flat_map(|mark| named(mark, &roots)) {
                paths += 1;
                let beside = |name: &str| path.parent().is_some_and(|page| page.join(name).exists());
                let (name, is_there) = match named {
                    Named::From(name) => (name, folder().join(name).exists() || beside(name)),
                    Named::End(name) => {
                        let ends = |whole: &String| {
                            whole.strip_suffix(name).is_some_and(|before| before.is_empty() || before.ends_with('/'))
                        };
                        (name, tree.iter().any(ends) || beside(name))
                    }
                };
                if !is_there {
                    faults.push(format!("{}:{line}: got {name}, wanted a file or folder of the tree", path.display()));
                }
            }
        }
    }
    assert!(paths > 300, "{paths} paths");
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

#[test]
fn a_path_is_told_from_other_code() {
    let roots = ["docs/".to_owned(), "host/".to_owned()];
    let one = |mark: &'static str| named(mark, &roots);
    assert_eq!(one("docs/GONE.md"), [Named::From("docs/GONE.md")]);
    assert_eq!(one("host/app/src/x.rs::run"), [Named::From("host/app/src/x.rs")]);
    assert_eq!(one("palpate push host/part.toml"), [Named::From("host/part.toml")]);
    assert_eq!(one("host/<name>/x.csv"), [Named::From("host/")]);
    assert_eq!(one("cli/NAME.rs"), [Named::End("cli/")]);
    assert_eq!(one("math/"), [Named::End("math/")]);
    assert_eq!(one("job.rs"), [Named::End("job.rs")]);
    for other in ["m/s", ".toml", "cargo test", "part.toml of mine", "t, Fx, Fy", "Spectrum::of"] {
        assert_eq!(one(other), [], "{other}");
    }
    let page = "# Changelog\n## Unreleased\n- `old/` → `new/`\n## 0.1\n- `gone/`\n";
    let lines = present(Path::new("CHANGELOG.md"), page);
    assert_eq!(lines, [(2, "## Unreleased"), (3, " `new/`")]);
}

/// Names that source code defines: items, fields, variants, parameters and variables, and names quoted for JSON.
/// Comments do not count.
fn defined(source: &str, names: &mut HashSet<String>) {
    const BEFORE: [&str; 11] =
        ["fn", "struct", "enum", "trait", "type", "const", "static", "mod", "let", "mut", "macro_rules!"];
    let is_word = |c: char| c.is_alphanumeric() || c == '_';
    for line in source.lines().map(str::trim_start).filter(|line| !line.starts_with("//")) {
        let mut before = "";
        let mut rest = line;
        while let Some(start) = rest.find(is_word) {
            let quoted = rest[..start].ends_with('"');
            let end = rest[start..].find(|c| !is_word(c)).map_or(rest.len(), |length| start + length);
            let (word, after) = (&rest[start..end], &rest[end..]);
            let is_field = after.starts_with(':') && !after.starts_with("::");
            let is_variant = word.starts_with(char::is_uppercase)
                && line.starts_with(word)
                && (after.is_empty() || after.starts_with([',', '(', ' ']));
            if BEFORE.contains(&before) || is_field || is_variant || (quoted && after.starts_with('"')) {
                names.insert(word.to_owned());
            }
            (before, rest) = (word, after);
        }
    }
}

/// The cells of a table's row; an escaped bar ends none.
fn cells(row: &str) -> Vec<String> {
    let plain = row.trim().trim_start_matches('|').replace("\\|", "\u{0}");
    let mut cells: Vec<_> = plain.split('|').map(|cell| cell.trim().replace('\u{0}', "|")).collect();
    cells.pop();
    cells
}

#[test]
fn names_in_the_tables_of_symbols_are_defined() {
    let mut names = HashSet::new();
    for source in tree().iter().filter(|name| name.ends_with(".rs") && !name.ends_with("commands/pages.rs")) {
        defined(&std::fs::read_to_string(folder().join(source)).unwrap(), &mut names);
    }
    let page = std::fs::read_to_string(folder().join(INDEX_PAGE)).unwrap();
    let (mut column, mut rows, mut faults) = (None, 0, Vec::new());
    for (line, text) in page.lines().enumerate().map(|(at, text)| (at + 1, text)) {
        if !text.starts_with('|') {
            column = None;
            continue;
        }
        let cells = cells(text);
        if let Some(code) = cells.iter().position(|cell| cell == "code") {
            column = Some(code);
            continue;
        }
        let Some(cell) = column.map(|column: usize| cells.get(column).map_or("", String::as_str)) else { continue };
        rows += usize::from(!cell.starts_with("---"));
        // A single letter is everywhere.
        let words = marked(cell).flat_map(|mark| mark.split(|c: char| !c.is_alphanumeric() && c != '_'));
        for word in words.filter(|word| word.chars().count() > 1 && !names.contains(*word)) {
            faults.push(format!("{INDEX_PAGE}:{line}: got {word}, wanted a name that is defined somewhere: {cell}"));
        }
    }
    assert!(rows > 150, "{INDEX_PAGE}: {rows} rows");
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

#[test]
fn what_is_defined_is_told_from_what_is_used() {
    let source = "// let gone = 1;\npub struct Part {\n    height: f64,\n}\nenum E {\n    Free,\n    Held(u8),\n}\n\
                  #[serde(rename = \"vT\")]\nlet mut sum = used(other::thing);\n";
    let mut names = HashSet::new();
    defined(source, &mut names);
    let found = ["Part", "height", "Free", "Held", "vT", "sum", "gone", "used", "other", "thing", "serde"];
    assert_eq!(
        found.map(|name| names.contains(name)),
        [true, true, true, true, true, true, false, false, false, false, false]
    );
}

#[test]
fn every_row_of_the_index_has_a_place_or_says_why_not() {
    let has_place = |row: &Row| marked(&row.place).any(|place| place.contains(".rs"));
    // "as (5.16)": like the row of that number.
    let says_why = |row: &Row| {
        row.place.starts_with("as ") || ["not built", "not drawn"].iter().any(|why| row.place.contains(why))
    };
    let open = index().into_iter().filter(|row| !has_place(row) && !says_why(row));
    let faults: Vec<_> =
        open.map(|row| format!("{INDEX_PAGE}:{}: got {:?}, wanted a place or a reason", row.line, row.place)).collect();
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

#[test]
fn a_definition_is_told_from_a_mention() {
    let source = "// fn gone() {}\npub(crate) const fn here() {}\nlet x = there();\n    struct Inner<T>;\n";
    let found = ["gone", "here", "there", "Inner", "Inn"].map(|name| defines(source, name));
    assert_eq!(found, [false, true, false, true, false]);
}
