//! ONNX Runtime: which libraries are refused, and that it finds what `rten` finds. The library is looked for in
//! `ORT_DYLIB_PATH`, else in the Python environment of `VIRTUAL_ENV`; without one the refusals are tested alone.
// A test may look for its library; the crate may not.
#![allow(clippy::disallowed_methods, clippy::print_stderr, clippy::unwrap_used)]
#![cfg(feature = "onnxruntime")]

use std::path::{Path, PathBuf};
use stillpoint_detection::{OnnxRuntime, RuntimeError};

/// The library to test with, if there is one.
fn library() -> Option<PathBuf> {
    let named = std::env::var_os("ORT_DYLIB_PATH").map(PathBuf::from);
    let found = named.or_else(|| {
        let environment = PathBuf::from(std::env::var_os("VIRTUAL_ENV")?);
        let entries = |folder: PathBuf| std::fs::read_dir(folder).into_iter().flatten().flatten();
        entries(environment.join("lib"))
            .flat_map(|python| entries(python.path().join("site-packages/onnxruntime/capi")))
            .map(|entry| entry.path())
            .find(|file| {
                let name = file.file_name().unwrap().to_string_lossy();
                name.starts_with("libonnxruntime.so") || name.ends_with(".dylib")
            })
    });
    if found.is_none() {
        eprintln!("SKIPPED: neither ORT_DYLIB_PATH nor VIRTUAL_ENV leads to ONNX Runtime");
    }
    found
}

/// A folder of this test alone, made anew.
fn scratch(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    if folder.exists() {
        std::fs::remove_dir_all(&folder).unwrap();
    }
    std::fs::create_dir_all(&folder).unwrap();
    folder.canonicalize().unwrap()
}

/// The error of a file, after what holds for all: one line that says what was expected, found and what to do.
fn refusal(file: &Path) -> RuntimeError {
    let error = OnnxRuntime::load(file).unwrap_err();
    let text = error.to_string();
    assert!(
        text.starts_with(&format!("{}: expected ", file.display())),
        "{text}"
    );
    assert!(text.contains("found") && !text.contains('\n'), "{text}");
    assert!(text.contains("pip install onnxruntime"), "{text}");
    assert!(text.contains("rten"), "{text}");
    error
}

#[test]
fn what_is_no_file_is_refused() {
    let folder = scratch("no_file");
    for path in [folder.join("missing.so"), folder.clone()] {
        assert_eq!(refusal(&path), RuntimeError::Missing { library: path });
    }
}

/// A pipe that nobody writes to must not be waited for.
#[cfg(unix)]
#[test]
fn what_is_no_regular_file_is_refused() {
    let null = PathBuf::from("/dev/null");
    assert_eq!(refusal(&null), RuntimeError::Missing { library: null });
    let pipe = scratch("pipe").join("pipe.so");
    let made = std::process::Command::new("mkfifo").arg(&pipe).status();
    if made.is_ok_and(|status| status.success()) {
        assert_eq!(refusal(&pipe), RuntimeError::Missing { library: pipe });
    }
}

#[test]
fn what_is_no_library_is_refused() {
    let folder = scratch("no_library");
    let text = "a page that says: not found\n".repeat(100);
    // The head of a library, and nothing behind it.
    let head = [&b"\x7fELF\x02\x01\x01"[..], &[0; 200]].concat();
    for (name, bytes) in [
        ("empty.so", &b""[..]),
        ("text.so", text.as_bytes()),
        ("head.so", &head),
    ] {
        let file = folder.join(name);
        std::fs::write(&file, bytes).unwrap();
        let error = refusal(&file);
        assert!(matches!(error, RuntimeError::Unloadable { .. }), "{error}");
    }
}

/// This program is whole, and of the format that libraries have on Linux: cut anywhere, it must be refused before the system
/// maps it, which would end the process.
#[cfg(target_os = "linux")]
#[test]
fn what_was_cut_is_refused() {
    let bytes = std::fs::read(std::env::current_exe().unwrap()).unwrap();
    let file = scratch("cut").join("cut.so");
    for part in [1, 10, 50, 90, 99] {
        let length = bytes.len() / 100 * part;
        std::fs::write(&file, &bytes[..length]).unwrap();
        let error = refusal(&file);
        let RuntimeError::Unloadable { reason, .. } = &error else {
            panic!("{error}");
        };
        assert!(
            reason.contains(&format!("the first {length} bytes")),
            "{reason}"
        );
    }
}

/// A library of the system that every program on Linux uses.
#[cfg(target_os = "linux")]
#[test]
fn another_library_is_refused() {
    let maps = std::fs::read_to_string("/proc/self/maps").unwrap();
    let library = maps
        .split_whitespace()
        .find(|word| word.starts_with('/') && word.contains("/libc.so"));
    let Some(library) = library else {
        eprintln!("SKIPPED: this program uses no libc.so");
        return;
    };
    let error = refusal(Path::new(library));
    assert!(matches!(error, RuntimeError::Foreign { .. }), "{error}");
}

#[test]
fn one_library_serves_the_process_and_another_is_refused() {
    let Some(file) = library() else { return };
    let first = OnnxRuntime::load(&file).unwrap();
    assert!(first.version().starts_with("1."), "{}", first.version());
    assert_eq!(first.library(), file.canonicalize().unwrap());
    assert_eq!(OnnxRuntime::load(&file).unwrap(), first);
    let copy = scratch("copy").join("libonnxruntime.so");
    std::fs::copy(&file, &copy).unwrap();
    let error = OnnxRuntime::load(&copy).unwrap_err();
    assert!(error.to_string().contains("loaded already"), "{error}");
    let taken = RuntimeError::Taken {
        library: copy.clone(),
        loaded: Some(first.library().to_owned()),
    };
    assert_eq!(error, taken);
    std::fs::remove_file(copy).unwrap();
    // A link to the first is the first.
    #[cfg(unix)]
    {
        let link = scratch("link").join("link.so");
        std::os::unix::fs::symlink(&file, &link).unwrap();
        assert_eq!(OnnxRuntime::load(&link).unwrap(), first);
    }
    assert_eq!(OnnxRuntime::load(&file).unwrap(), first);
}
