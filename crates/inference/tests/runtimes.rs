//! ONNX Runtime: refused libraries, and agreement with `rten`. `ORT_DYLIB_PATH` names the library; without it only the refusals are tested.

use std::path::{Path, PathBuf};
use stillpoint_detection::{Detection, Detector};
use stillpoint_imaging::{ColourImage, FrameId};
use stillpoint_inference::{
    InputSize, OnnxDetector, OnnxOptions, OnnxRuntime, Runtime, RuntimeError,
};

/// The library to test with, if any.
pub(crate) fn library() -> Option<PathBuf> {
    let named = std::env::var_os("ORT_DYLIB_PATH").map(PathBuf::from);
    if named.is_none() {
        stillpoint_testdata::skipped("ORT_DYLIB_PATH names no library of ONNX Runtime");
    }
    named
}

/// Detections of a shared model in a shared image in this runtime, if both exist; and the name of the runtime.
fn found(model: &str, runtime: &Runtime, threads: usize) -> Option<(Vec<Detection>, String)> {
    let shared = |file: &str| Some(std::fs::read(stillpoint_testdata::beside(file)?).unwrap());
    let image = image::load_from_memory(&shared("images/bus.jpg")?)
        .unwrap()
        .to_rgb8();
    let (width, height) = (image.width() as usize, image.height() as usize);
    let image = ColourImage::from_vec(width, height, image.into_raw()).unwrap();
    let options = OnnxOptions {
        threads,
        input: InputSize::Model,
        ..OnnxOptions::default()
    };
    let model = shared(&format!("models/{model}.onnx"))?;
    let mut detector = OnnxDetector::with_card(model, "model", None, runtime, &options).unwrap();
    let found = detector.detect_image(&image, FrameId(0)).unwrap();
    // Bit-identical on repetition.
    assert_eq!(detector.detect_image(&image, FrameId(1)).unwrap(), found);
    Some((found, detector.info().runtime.unwrap()))
}

#[test]
fn both_runtimes_give_the_same_detections() {
    let Some(file) = library() else { return };
    let library = OnnxRuntime::load(&file).unwrap();
    let runtime = Runtime::OnnxRuntime(library.clone());
    for model in ["yolox_nano_416", "picodet_s_416_coco"] {
        let Some((expected, _)) = found(model, &Runtime::Rten, 1) else {
            return;
        };
        assert!(expected.len() >= 4, "{model}: {expected:?}");
        for threads in [1, 2] {
            let (found, name) = found(model, &runtime, threads).unwrap();
            assert_eq!(name, format!("ONNX Runtime {}", library.version()));
            assert_eq!(
                found.len(),
                expected.len(),
                "{model}: {found:?}, {expected:?}"
            );
            for (a, b) in found.iter().zip(&expected) {
                assert_eq!(a.class, b.class, "{model}");
                assert!((a.score - b.score).abs() < 1e-4, "{model}: {a:?}, {b:?}");
                let (a, b) = (a.bounds, b.bounds);
                let sides = [a.x0 - b.x0, a.y0 - b.y0, a.x1 - b.x1, a.y1 - b.y1];
                assert!(sides.iter().all(|s| s.abs() < 0.1), "{model}: {a:?}, {b:?}");
            }
        }
    }
}

/// A folder of this test alone, emptied first.
fn scratch(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    if folder.exists() {
        std::fs::remove_dir_all(&folder).unwrap();
    }
    std::fs::create_dir_all(&folder).unwrap();
    folder.canonicalize().unwrap()
}

/// The error of a file, after general checks: one line with the expectation, the finding and the remedy.
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
fn missing_library_file_is_refused() {
    let folder = scratch("no_file");
    for path in [folder.join("missing.so"), folder.clone()] {
        assert_eq!(refusal(&path), RuntimeError::Missing { library: path });
    }
}

/// A pipe without a writer must not block.
#[cfg(unix)]
#[test]
fn non_regular_library_file_is_refused() {
    let null = PathBuf::from("/dev/null");
    assert_eq!(refusal(&null), RuntimeError::Missing { library: null });
    let pipe = scratch("pipe").join("pipe.so");
    let made = std::process::Command::new("mkfifo").arg(&pipe).status();
    if made.is_ok_and(|status| status.success()) {
        assert_eq!(refusal(&pipe), RuntimeError::Missing { library: pipe });
    }
}

#[test]
fn non_library_file_is_refused() {
    let folder = scratch("no_library");
    let text = "a page that says: not found\n".repeat(100);
    // Only the head of a library.
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

/// This program's file is complete, and of the format that libraries have on Linux: truncated anywhere, it must be refused before the
/// system maps it, which would end the process.
#[cfg(target_os = "linux")]
#[test]
fn truncated_library_is_refused() {
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
fn unrelated_library_is_refused() {
    let maps = std::fs::read_to_string("/proc/self/maps").unwrap();
    let library = maps
        .split_whitespace()
        .find(|word| word.starts_with('/') && word.contains("/libc.so"));
    let Some(library) = library else {
        stillpoint_testdata::skipped("the test program uses no libc.so");
        return;
    };
    let error = refusal(Path::new(library));
    assert!(matches!(error, RuntimeError::Foreign { .. }), "{error}");
}

#[test]
fn process_uses_one_library_and_refuses_another() {
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
