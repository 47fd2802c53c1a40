//! A folder of part files: the parts that it may be.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use miette::{IntoDiagnostic as _, WrapErr as _, miette};
use palpate_files::part::PolygonFile;

use super::touch_world::read_part;

/// The part files of a folder, in the order of their names: those that end in `.toml`. A library holds nothing else under that
/// ending.
pub(super) fn part_files(folder: &Path) -> miette::Result<BTreeMap<String, PathBuf>> {
    let cannot = || format!("cannot use the library {}", folder.display());
    let mut files = BTreeMap::new();
    for entry in std::fs::read_dir(folder).into_diagnostic().wrap_err_with(cannot)? {
        let path = entry.into_diagnostic().wrap_err_with(cannot)?.path();
        if path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("toml")) {
            let name = path.file_stem().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
            files.insert(name, path);
        }
    }
    if files.is_empty() {
        let help = "a library is a folder of part files, each ending in .toml";
        return Err(miette!(help = help, "there is no part in it")).wrap_err_with(cannot);
    }
    Ok(files)
}

/// The parts of a folder by name: polygons, on one support each.
pub(super) fn read_library(folder: &Path) -> miette::Result<Vec<(String, PolygonFile)>> {
    part_files(folder)?.into_iter().map(|(name, path)| Ok((name, read_part(&path)?))).collect()
}
