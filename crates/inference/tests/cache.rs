//! The cache: installed models are found, and damaged or foreign files are reported.

use stillpoint_inference::{Cache, CacheError, LARGEST, Record, State, check_name, sha256_hex};

fn scratch() -> (tempfile::TempDir, Cache) {
    let folder = tempfile::tempdir().unwrap();
    let cache = Cache::at(folder.path().join("cache"));
    (folder, cache)
}

fn install(cache: &Cache, name: &str, onnx: &[u8]) {
    cache.install(name, onnx, None, Record::default()).unwrap();
}

fn names(cache: &Cache) -> Vec<String> {
    cache.list().unwrap().into_iter().map(|m| m.name).collect()
}

fn damage(cache: &Cache, name: &str) -> String {
    let model = cache.find(name).unwrap().unwrap();
    let State::Damaged(reason) = &model.state else {
        panic!("{:?}", model.state);
    };
    assert_eq!(model.read().unwrap_err().to_string(), *reason);
    assert!(!reason.contains('\n'), "{reason}");
    reason.clone()
}

#[test]
fn missing_cache_folder_is_empty() {
    let (folder, cache) = scratch();
    assert!(cache.list().unwrap().is_empty());
    assert!(cache.strays().unwrap().is_empty());
    assert_eq!(cache.find("yolox-nano").unwrap(), None);
    assert_eq!(cache.preferred(["net"]).unwrap(), None);
    assert!(
        !folder.path().join("cache").exists(),
        "looking makes nothing"
    );
}

#[test]
fn installed_models_are_found() {
    let (_folder, cache) = scratch();
    let source = Record::of("/home/ada/net.onnx", b"network");
    let model = cache
        .install("net", b"network", Some("head = 1\n"), source)
        .unwrap();
    assert_eq!(cache.find("net").unwrap().as_ref(), Some(&model));
    assert_eq!(cache.list().unwrap(), std::slice::from_ref(&model));
    assert_eq!(model.state, State::Good);
    assert_eq!(
        (model.bytes, model.sha256.as_str()),
        (7, sha256_hex(b"network").as_str())
    );
    assert_eq!(model.onnx, cache.onnx_path("net"));
    assert_eq!(model.card, Some(cache.card_path("net")));
    assert_eq!(model.card_text().unwrap().as_deref(), Some("head = 1\n"));
    assert_eq!(model.read().unwrap(), b"network");
    let record = model.record.unwrap();
    assert_eq!(record.source.as_deref(), Some("/home/ada/net.onnx"));
    assert_eq!((record.sha256, record.bytes), (model.sha256, 7));
    assert!(record.installed.unwrap().ends_with('Z'));
    assert!(cache.strays().unwrap().is_empty());

    // A new one of the same name replaces all files; its missing card removes the old card.
    install(&cache, "net", b"other");
    let other = cache.find("net").unwrap().unwrap();
    assert_eq!(
        (other.read().unwrap().as_slice(), other.card),
        (b"other".as_slice(), None)
    );
    assert_eq!(other.record.unwrap().source, None);
    assert_eq!(other.state, State::Good);
}

#[test]
fn names_cannot_leave_the_folder() {
    let (folder, cache) = scratch();
    std::fs::write(folder.path().join("outside.onnx"), b"outside").unwrap();
    for name in [
        "../../outside",
        "..",
        "",
        "a/b",
        "a\\b",
        "nul",
        "x.onnx",
        "a\0",
    ] {
        assert!(check_name(name).is_err());
        let e = cache
            .install(name, b"x", None, Record::default())
            .unwrap_err();
        assert!(matches!(e, CacheError::Name { .. }), "{e}");
        assert_eq!(cache.find(name).unwrap(), None, "{name:?}");
    }
    assert!(!cache.folder().exists());
}

#[test]
fn damage_is_reported() {
    let (_folder, cache) = scratch();
    install(&cache, "net", b"network");
    install(&cache, "good", b"good");
    std::fs::write(cache.onnx_path("net"), b"netwark").unwrap();
    let reason = damage(&cache, "net");
    for part in [
        &sha256_hex(b"network"),
        &sha256_hex(b"netwark"),
        "get it again",
    ] {
        assert!(reason.contains(part), "{reason}");
    }
    std::fs::write(cache.onnx_path("net"), b"").unwrap();
    assert!(damage(&cache, "net").contains("0 bytes"));

    for record in [
        "",
        "banana",
        "sha256 = \"\"",
        "sha256 = \"x\"\nbytes = -1",
        "\u{1}",
    ] {
        std::fs::write(cache.record_path("net"), record).unwrap();
        assert!(damage(&cache, "net").contains("remove this file"));
    }
    std::fs::write(cache.record_path("net"), [0xff; 100_000]).unwrap();
    assert!(damage(&cache, "net").contains("remove this file"));
    std::fs::remove_file(cache.record_path("net")).unwrap();
    std::fs::create_dir(cache.record_path("net")).unwrap();
    damage(&cache, "net");

    std::fs::remove_file(cache.onnx_path("net")).unwrap();
    std::fs::create_dir(cache.onnx_path("net")).unwrap();
    assert!(damage(&cache, "net").contains("not a file"));
    // A dangling link.
    #[cfg(unix)]
    {
        std::fs::remove_dir(cache.onnx_path("net")).unwrap();
        std::os::unix::fs::symlink("/no/such.onnx", cache.onnx_path("net")).unwrap();
        assert!(damage(&cache, "net").contains("check that it exists"));
    }
    // A damaged model does not hide the others.
    assert_eq!(names(&cache), ["good", "net"]);
    assert_eq!(cache.find("good").unwrap().unwrap().state, State::Good);
}

#[test]
fn files_changed_after_lookup_are_detected() {
    let (_folder, cache) = scratch();
    install(&cache, "net", b"network");
    let model = cache.find("net").unwrap().unwrap();
    std::fs::write(&model.onnx, b"another").unwrap();
    assert!(matches!(model.read(), Err(CacheError::Changed { .. })));
    std::fs::remove_file(&model.onnx).unwrap();
    assert!(matches!(model.read(), Err(CacheError::Read { .. })));
}

#[test]
fn manually_placed_files_are_models() {
    let (_folder, cache) = scratch();
    std::fs::create_dir_all(cache.folder()).unwrap();
    std::fs::write(cache.onnx_path("own"), b"own").unwrap();
    std::fs::write(cache.card_path("own"), b"card").unwrap();
    let own = cache.find("own").unwrap().unwrap();
    assert_eq!((own.state.clone(), own.record.clone()), (State::Own, None));
    assert_eq!(own.read().unwrap(), b"own");
    assert_eq!(own.card_text().unwrap().as_deref(), Some("card"));

    // Above the size limit; sparse, so that it takes no disk space.
    let file = std::fs::File::create(cache.onnx_path("huge")).unwrap();
    file.set_len(LARGEST + 1).unwrap();
    assert!(damage(&cache, "huge").contains("536870913"));
}

#[test]
fn foreign_files_are_reported() {
    let (_folder, cache) = scratch();
    install(&cache, "net", b"network");
    std::fs::create_dir(cache.folder().join("photos")).unwrap();
    for file in [
        "notes.txt",
        "yolox-nano.part",
        "yolox-nano.part.toml",
        "old.toml",
        "old.record.toml",
        ".net.1-2.tmp",
        "yolov7-tiny.sha256",
        "yolox-nano.lock",
        "bad name.onnx",
        "nul.onnx",
    ] {
        std::fs::write(cache.folder().join(file), b"12345").unwrap();
    }
    let strays = cache.strays().unwrap();
    let listed: Vec<(String, &str, u64)> = strays
        .iter()
        .map(|s| {
            (
                s.path.file_name().unwrap().to_string_lossy().into_owned(),
                s.what,
                s.bytes,
            )
        })
        .collect();
    for (file, part, bytes) in [
        (".net.1-2.tmp", "may be removed", 5),
        ("bad name.onnx", "not a model", 5),
        ("notes.txt", "not a model", 5),
        ("nul.onnx", "not a model", 5),
        ("old.record.toml", "without a model", 5),
        ("old.toml", "without a model", 5),
        ("photos", "not a model", 0),
        ("yolox-nano.part", "resumes", 5),
    ] {
        let found = listed.iter().find(|(name, ..)| name == file);
        let (_, what, size) = found.unwrap_or_else(|| panic!("{file} in {listed:?}"));
        assert!(what.contains(part) && *size == bytes, "{file}: {what}");
    }
    assert_eq!(listed.len(), 8, "{listed:?}");
    assert_eq!(names(&cache), ["net"]);
}

#[test]
fn preferred_models_come_first_then_alphabetical_order() {
    let (_folder, cache) = scratch();
    let order = ["yolov7-tiny", "yolox-tiny", "yolox-nano"];
    let preferred = |cache: &Cache| cache.preferred(order).unwrap().unwrap().name;
    for (name, first) in [
        ("zebra", "zebra"),
        ("apple", "apple"),
        ("yolox-nano", "yolox-nano"),
        ("yolox-tiny", "yolox-tiny"),
        ("yolov7-tiny", "yolov7-tiny"),
    ] {
        install(&cache, name, name.as_bytes());
        assert_eq!(preferred(&cache), first);
    }
    // A damaged one is not skipped silently.
    std::fs::write(cache.onnx_path("yolov7-tiny"), b"damaged").unwrap();
    let model = cache.preferred(order).unwrap().unwrap();
    assert_eq!(model.name, "yolov7-tiny");
    assert!(model.read().is_err());
}

#[test]
fn file_in_place_of_the_cache_is_reported() {
    let (folder, cache) = scratch();
    std::fs::write(folder.path().join("cache"), b"a file").unwrap();
    let expected = folder.path().join("cache").display().to_string();
    let failures = [
        cache.list().map(|_| ()),
        cache.strays().map(|_| ()),
        cache.find("net").map(|_| ()),
        cache.preferred([]).map(|_| ()),
        cache
            .install("net", b"x", None, Record::default())
            .map(|_| ()),
    ];
    for failure in failures {
        let e = failure.unwrap_err();
        assert!(matches!(e, CacheError::NoFolder { .. }), "{e}");
        assert!(e.to_string().contains(&expected), "{e}");
    }
    assert_eq!(
        std::fs::read(folder.path().join("cache")).unwrap(),
        b"a file"
    );
}

/// The superuser may write everywhere, so the test does nothing for it.
#[cfg(unix)]
#[test]
fn unwritable_folder_is_reported() {
    use std::os::unix::fs::PermissionsExt;
    let (_folder, cache) = scratch();
    install(&cache, "net", b"network");
    let folder = cache.folder();
    std::fs::set_permissions(&folder, PermissionsExt::from_mode(0o555)).unwrap();
    if std::fs::write(folder.join("probe"), b"").is_ok() {
        stillpoint_testdata::skipped("permissions do not hold for the superuser");
        return;
    }
    let e = cache
        .install("net", b"other", None, Record::default())
        .unwrap_err();
    assert!(
        e.to_string().contains("check the folder's permissions"),
        "{e}"
    );
    assert_eq!(
        cache.find("net").unwrap().unwrap().read().unwrap(),
        b"network"
    );
    std::fs::set_permissions(&folder, PermissionsExt::from_mode(0o755)).unwrap();
}

#[test]
fn concurrent_installations_do_not_mix() {
    let (_folder, cache) = scratch();
    std::thread::scope(|scope| {
        for writer in 0..4_u8 {
            let cache = &cache;
            scope.spawn(move || {
                for round in 0..10 {
                    let bytes = [writer, round].repeat(1000);
                    let card = format!("writer {writer}, round {round}");
                    cache
                        .install("net", &bytes, Some(&card), Record::default())
                        .unwrap();
                }
            });
        }
    });
    let model = cache.find("net").unwrap().unwrap();
    assert_eq!(model.state, State::Good);
    let bytes = model.read().unwrap();
    let card = format!("writer {}, round {}", bytes[0], bytes[1]);
    assert_eq!(model.card_text().unwrap(), Some(card));
    assert!(cache.strays().unwrap().is_empty());
}
