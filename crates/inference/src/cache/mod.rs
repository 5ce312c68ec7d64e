//! The cache: a folder of the user's in which models lie under their names.
//!
//! For a model `NAME`, the folder `models` holds `NAME.onnx`, the network; `NAME.toml`, its card, if it has one; `NAME.record.toml`, where it
//! came from ([`Record`]); and, for models whose publisher states no checksum, `NAME.sha256`, the checksum of the first download. While a
//! download is unfinished there are also `NAME.part` and `NAME.part.toml`. Files that a user puts there by hand are models, too.

mod error;
mod install;
mod listing;
mod name;
mod record;

pub use error::CacheError;
pub use listing::{CachedModel, State, Stray};
pub use name::check_name;
pub use record::{Form, Record, now};

use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// Largest model that is downloaded or read, bytes. Detectors that run on a CPU at the rate of a camera have some ten MB; the limit keeps a
/// server that never ends from filling the disk.
pub const LARGEST: u64 = 512 * 1024 * 1024;

/// A folder with models. It need not exist: it is made when the first model is put there.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Cache {
    root: PathBuf,
}

/// Where caches are by custom.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Platform {
    Unix,
    MacOs,
    Windows,
}

const HERE: Platform = if cfg!(windows) {
    Platform::Windows
} else if cfg!(target_os = "macos") {
    Platform::MacOs
} else {
    Platform::Unix
};

impl Cache {
    /// The cache in this folder; models lie in its folder `models`.
    #[must_use]
    pub fn at(root: impl Into<PathBuf>) -> Self {
        Self { root: root.into() }
    }

    /// The user's cache: `STILLPOINT_CACHE`, else `stillpoint` in `XDG_CACHE_HOME`, else in the system's customary folder:
    /// `~/.cache`, on macOS `~/Library/Caches`, on Windows `%LOCALAPPDATA%`. Empty variables count as unset, and so does
    /// an `XDG_CACHE_HOME` that is not absolute, as its specification says. The environment is an argument, so that tests have their own.
    ///
    /// # Errors
    /// [`CacheError::NoHome`] if none of them is set.
    pub fn of_user(environment: &dyn Fn(&str) -> Option<OsString>) -> Result<Self, CacheError> {
        Self::of_user_on(HERE, environment)
    }

    fn of_user_on(
        platform: Platform,
        environment: &dyn Fn(&str) -> Option<OsString>,
    ) -> Result<Self, CacheError> {
        let folder = |name: &str| {
            environment(name)
                .filter(|value| !value.is_empty())
                .map(PathBuf::from)
        };
        if let Some(root) = folder("STILLPOINT_CACHE") {
            return Ok(Self::at(root));
        }
        let (custom, looked) = match platform {
            Platform::Unix => (
                folder("HOME").map(|home| home.join(".cache")),
                "STILLPOINT_CACHE, XDG_CACHE_HOME, HOME",
            ),
            Platform::MacOs => (
                folder("HOME").map(|home| home.join("Library/Caches")),
                "STILLPOINT_CACHE, XDG_CACHE_HOME, HOME",
            ),
            Platform::Windows => (
                folder("LOCALAPPDATA"),
                "STILLPOINT_CACHE, XDG_CACHE_HOME, LOCALAPPDATA",
            ),
        };
        folder("XDG_CACHE_HOME")
            .filter(|path| path.is_absolute())
            .or(custom)
            .map(|caches| Self::at(caches.join("stillpoint")))
            .ok_or(CacheError::NoHome { looked })
    }

    /// The folder of the models. It may not exist yet.
    #[must_use]
    pub fn folder(&self) -> PathBuf {
        self.root.join("models")
    }

    /// Where the network of this model lies, or would lie.
    #[must_use]
    pub fn onnx_path(&self, name: &str) -> PathBuf {
        self.file(name, "onnx")
    }

    /// Where the card of this model lies, or would lie.
    #[must_use]
    pub fn card_path(&self, name: &str) -> PathBuf {
        self.file(name, "toml")
    }

    /// Where the record of this model lies, or would lie.
    #[must_use]
    pub fn record_path(&self, name: &str) -> PathBuf {
        self.file(name, "record.toml")
    }

    /// Where the file with this suffix lies beside a model, or would lie, e.g. `NAME.part`. The name has passed [`check_name`].
    #[must_use]
    pub fn file(&self, name: &str, suffix: &str) -> PathBuf {
        self.folder().join(format!("{name}.{suffix}"))
    }

    /// Makes the folder where it is missing, and gives it.
    ///
    /// # Errors
    /// It cannot be made, or something else is in its way.
    pub fn make(&self) -> Result<PathBuf, CacheError> {
        let folder = self.folder();
        if let Some(path) = in_the_way(&folder) {
            return Err(CacheError::NoFolder {
                path: path.to_owned(),
                found: "a file",
            });
        }
        match std::fs::create_dir_all(&folder) {
            Ok(()) => Ok(folder),
            Err(source) => Err(CacheError::Write {
                path: folder,
                source,
            }),
        }
    }
}

/// What exists of the path, or above it, without being a folder.
pub(crate) fn in_the_way(folder: &Path) -> Option<&Path> {
    folder.ancestors().find(|p| p.exists() && !p.is_dir())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(platform: Platform, variables: &[(&str, &str)]) -> Option<PathBuf> {
        let environment = |name: &str| {
            variables
                .iter()
                .find(|(key, _)| *key == name)
                .map(|(_, value)| OsString::from(value))
        };
        Cache::of_user_on(platform, &environment)
            .ok()
            .map(|cache| cache.folder())
    }

    #[test]
    fn the_environment_names_the_folder() {
        use Platform::{MacOs, Unix, Windows};
        let home = ("HOME", "/home/ada");
        let xdg = ("XDG_CACHE_HOME", "/var/caches");
        let own = ("STILLPOINT_CACHE", "/big disk");
        let local = ("LOCALAPPDATA", "/users/ada/local");
        for (platform, variables, folder) in [
            (Unix, vec![home, xdg, own], Some("/big disk/models")),
            (Unix, vec![home, xdg], Some("/var/caches/stillpoint/models")),
            (Unix, vec![home], Some("/home/ada/.cache/stillpoint/models")),
            (
                Unix,
                vec![home, ("XDG_CACHE_HOME", "caches"), ("STILLPOINT_CACHE", "")],
                Some("/home/ada/.cache/stillpoint/models"),
            ),
            (
                MacOs,
                vec![home],
                Some("/home/ada/Library/Caches/stillpoint/models"),
            ),
            (
                Windows,
                vec![home, local],
                Some("/users/ada/local/stillpoint/models"),
            ),
            (Windows, vec![home], None),
            (Unix, vec![local], None),
            (Unix, vec![("HOME", "")], None),
        ] {
            assert_eq!(at(platform, &variables), folder.map(PathBuf::from));
        }
    }

    #[test]
    fn no_home_says_what_to_set() {
        let e = Cache::of_user(&|_| None).unwrap_err().to_string();
        assert!(e.contains("set STILLPOINT_CACHE"), "{e}");
    }
}
