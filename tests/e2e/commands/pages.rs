//! The pages a person reads: what they mark up and where they lead.

use std::path::PathBuf;

use palpate_tests::project::folder;

fn pages() -> Vec<(PathBuf, String)> {
    let folders = [".", "docs", "calibration", "firmware/board"].map(|name| folder().join(name));
    let files = folders.iter().flat_map(|folder| std::fs::read_dir(folder).unwrap()).map(|entry| entry.unwrap().path());
    let pages: Vec<_> = files
        .filter(|path| path.extension().is_some_and(|extension| extension == "md"))
        .map(|path| (path.clone(), std::fs::read_to_string(path).unwrap()))
        .collect();
    assert!(pages.len() >= 8, "{} pages", pages.len());
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
