//! Files that are written whole or not at all.
//!
//! What is written goes to a file of another name in the same folder, onto the disk, and only then takes the name asked
//! for. Whatever stops it, a full disk, a killed program or a pulled plug, what was there before stays as it was, and the
//! other file goes where the program lives to remove it.
//!
//! Errors: [`OutputError`] says what was being done to which file.

use std::fs;
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

use tempfile::NamedTempFile;

/// Why a file was not written.
#[derive(Debug, thiserror::Error)]
pub enum OutputError {
    /// The operating system refused.
    #[error("cannot {doing} {path}")]
    Io {
        /// What was tried, in words.
        doing: &'static str,
        /// File or folder that was meant.
        path: PathBuf,
        /// Reason that the system gives.
        #[source]
        source: io::Error,
    },
    /// There is one of that name, which is not to be replaced.
    #[error("{0} exists already and is never overwritten")]
    Exists(PathBuf),
}

/// Writes a file, in place of what is there by that name. Its folder must be there.
///
/// # Errors
/// [`OutputError::Io`]; what was there stays.
pub fn replace(path: &Path, bytes: &[u8]) -> Result<(), OutputError> {
    // A device or a pipe is written to, not replaced.
    if fs::metadata(path).is_ok_and(|there| !there.is_file() && !there.is_dir()) {
        return fs::write(path, bytes).map_err(at("write", path));
    }
    // What a link points to is replaced, not the link.
    let target = fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
    let temporary = written_beside(&target, bytes)?;
    temporary.persist(&target).map(drop).map_err(|failed| at("name", &target)(failed.error))
}

/// Writes a file that did not exist. Folders on the way are made.
///
/// # Errors
/// [`OutputError::Exists`], also where another process has taken the name meanwhile; [`OutputError::Io`].
pub fn write_new(path: &Path, bytes: &[u8]) -> Result<(), OutputError> {
    if path.exists() {
        return Err(OutputError::Exists(path.to_owned()));
    }
    fs::create_dir_all(folder_of(path)).map_err(at("create", folder_of(path)))?;
    let temporary = written_beside(path, bytes)?;
    match temporary.persist_noclobber(path) {
        Ok(_) => Ok(()),
        Err(failed) if failed.error.kind() == io::ErrorKind::AlreadyExists => Err(OutputError::Exists(path.to_owned())),
        // Some file systems have no links (FAT): there the name is taken by renaming, which was free a moment ago.
        Err(failed) if !path.exists() => {
            failed.file.persist(path).map(drop).map_err(|failed| at("name", path)(failed.error))
        }
        Err(failed) => Err(at("name", path)(failed.error)),
    }
}

/// A file in the folder of another, whole and on the disk; gone when it is dropped.
fn written_beside(path: &Path, bytes: &[u8]) -> Result<NamedTempFile, OutputError> {
    let folder = folder_of(path);
    let mut temporary = new_file(folder).map_err(at("write in", folder))?;
    let written = temporary.write_all(bytes).and_then(|()| temporary.as_file().sync_all());
    written.map_err(at("write", path))?;
    Ok(temporary)
}

fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// As any other program's files: readable by whom the system's mask lets.
fn new_file(folder: &Path) -> io::Result<NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(".palpate-").suffix(".tmp");
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt as _;
        builder.permissions(fs::Permissions::from_mode(0o666));
    }
    builder.tempfile_in(folder)
}

fn at(doing: &'static str, path: &Path) -> impl Fn(io::Error) -> OutputError + use<> {
    let path = path.to_owned();
    move |source| OutputError::Io { doing, path: path.clone(), source }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Names of the files in a folder.
    fn names(folder: &Path) -> Vec<String> {
        let mut names: Vec<_> =
            fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    #[test]
    fn a_file_is_replaced_whole_and_nothing_is_left_beside_it() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("new/a.txt");
        assert!(replace(&path, b"nowhere").is_err(), "a folder that is not there may be a slip of the pen");
        fs::create_dir(folder.path().join("new")).unwrap();
        for text in ["first", "second, which is longer", ""] {
            replace(&path, text.as_bytes()).unwrap();
            assert_eq!(fs::read_to_string(&path).unwrap(), text);
        }
        assert_eq!(names(&folder.path().join("new")), ["a.txt"]);
    }

    #[test]
    fn a_file_that_must_be_new_is_never_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        write_new(&path, b"first").unwrap();
        assert!(matches!(write_new(&path, b"second"), Err(OutputError::Exists(_))));
        assert_eq!((fs::read(&path).unwrap(), names(folder.path())), (b"first".to_vec(), vec!["a.txt".to_owned()]));
    }

    #[cfg(unix)]
    #[test]
    fn links_stay_links_and_files_are_as_readable_as_others() {
        use std::os::unix::fs::PermissionsExt as _;
        let folder = tempfile::tempdir().unwrap();
        let (path, link) = (folder.path().join("a.txt"), folder.path().join("link"));
        replace(&path, b"first").unwrap();
        std::os::unix::fs::symlink(&path, &link).unwrap();
        replace(&link, b"second").unwrap();
        assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
        assert_eq!(fs::read(&path).unwrap(), b"second");
        let plain = folder.path().join("plain");
        fs::write(&plain, "").unwrap();
        let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode();
        assert_eq!(mode(&path), mode(&plain));
    }

    /// A disk of a few pages, where the machine lets us have one.
    #[cfg(target_os = "linux")]
    #[test]
    fn a_full_disk_leaves_what_was_there() {
        // Writing to it fails as on a full disk; it is a device, not a file.
        let error = replace(Path::new("/dev/full"), b"more").unwrap_err();
        let OutputError::Io { source, .. } = error else { panic!("{error}") };
        assert_eq!(source.kind(), io::ErrorKind::StorageFull);
    }

    #[cfg(unix)]
    #[test]
    fn a_folder_that_may_not_be_written_to_keeps_its_file() {
        use std::os::unix::fs::PermissionsExt as _;
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        replace(&path, b"first").unwrap();
        fs::set_permissions(folder.path(), fs::Permissions::from_mode(0o555)).unwrap();
        let written = replace(&path, b"second");
        fs::set_permissions(folder.path(), fs::Permissions::from_mode(0o755)).unwrap();
        // Whoever may do everything may do that too.
        if written.is_err() {
            assert_eq!(fs::read(&path).unwrap(), b"first");
        }
        assert_eq!(names(folder.path()), ["a.txt"]);
    }
}
