//! Installations that fail before any change.

use stillpoint_inference::{Cache, CacheError, LARGEST, Record, State};

fn scratch() -> (tempfile::TempDir, Cache) {
    let folder = tempfile::tempdir().unwrap();
    let cache = Cache::at(folder.path().join("cache"));
    (folder, cache)
}

#[test]
fn failed_installation_keeps_the_older_model() {
    let (_folder, cache) = scratch();
    cache
        .install("net", b"network", None, Record::default())
        .unwrap();
    // The lock cannot be taken, after all temporary files were written.
    let lock = cache.folder().join(".install.lock");
    std::fs::remove_file(&lock).unwrap();
    std::fs::create_dir(&lock).unwrap();
    let e = cache
        .install("net", b"other", Some("card"), Record::default())
        .unwrap_err();
    assert!(matches!(e, CacheError::Write { .. }), "{e}");
    let model = cache.find("net").unwrap().unwrap();
    assert_eq!(
        (model.read().unwrap().as_slice(), model.card),
        (b"network".as_slice(), None)
    );
    assert!(cache.strays().unwrap().is_empty(), "nothing is left behind");
}

#[test]
fn blocking_folders_are_detected_before_replacing() {
    let (_folder, cache) = scratch();
    cache
        .install("net", b"network", None, Record::default())
        .unwrap();
    let card = cache.card_path("net");
    std::fs::create_dir(&card).unwrap();
    for new in [None, Some("card")] {
        let e = cache
            .install("net", b"other", new, Record::default())
            .unwrap_err();
        assert!(e.to_string().contains(&card.display().to_string()), "{e}");
        let model = cache.find("net").unwrap().unwrap();
        assert_eq!(model.read().unwrap(), b"network");
    }
    std::fs::remove_dir(&card).unwrap();
    std::fs::remove_file(cache.onnx_path("net")).unwrap();
    std::fs::create_dir(cache.onnx_path("net")).unwrap();
    let record = std::fs::read(cache.record_path("net")).unwrap();
    let e = cache
        .install("net", b"other", Some("card"), Record::default())
        .unwrap_err();
    assert!(e.to_string().contains("net.onnx"), "{e}");
    assert!(!card.exists());
    assert_eq!(std::fs::read(cache.record_path("net")).unwrap(), record);
}

#[test]
fn oversized_model_is_not_installed() {
    let (folder, cache) = scratch();
    // Untouched zeros take no memory.
    let huge = vec![0; usize::try_from(LARGEST).unwrap() + 1];
    let e = cache
        .install("net", &huge, None, Record::default())
        .unwrap_err();
    assert!(matches!(e, CacheError::TooLarge { .. }), "{e}");
    assert!(!folder.path().join("cache").exists());
}

#[test]
fn model_may_be_named_install() {
    let (_folder, cache) = scratch();
    let model = cache
        .install("install", b"network", None, Record::default())
        .unwrap();
    assert_eq!(model.state, State::Good);
    // The lock of its download would be here.
    assert!(!cache.folder().join("install.lock").exists());
}
