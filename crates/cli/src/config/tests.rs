//! Tests of the configuration layers: precedence and error messages.

use super::*;
use crate::config::docs::doc_of;

fn layered(texts: &[(&str, bool)]) -> Result<Config, String> {
    let mut layers = Layers::new().unwrap();
    for (text, is_file) in texts {
        let origin = if *is_file {
            Origin::File(Path::new("my.toml"))
        } else {
            Origin::Set(text)
        };
        layers.add(text, &origin).map_err(|e| e.to_string())?;
    }
    Ok(layers.config)
}

#[test]
fn later_layers_override_only_their_keys() {
    let c = layered(&[
        ("seed = 3\n[tracking]\nmin_inliers = 40\n", true),
        ("tracking.min_inliers=50", false),
    ])
    .unwrap();
    assert_eq!((c.seed, c.tracking.min_inliers), (3, 50));
    assert_eq!(c.mapping, Config::default().mapping);
}

#[test]
fn set_arguments_need_no_quotes_for_words() {
    let mut layers = Layers::new().unwrap();
    for (set, text) in [
        ("static_filter.preset=off", "static_filter.preset=\"off\""),
        ("static_filter.preset = off", "static_filter.preset=\"off\""),
        (
            "static_filter.preset=\"off\"",
            "static_filter.preset=\"off\"",
        ),
        ("seed=off", "seed=\"off\""),
        ("preset=off", "preset=\"off\""),
        ("seed=4", "seed=4"),
        ("sensor.max_depth=1e1", "sensor.max_depth=1e1"),
        ("sensor.max_depth=5.5", "sensor.max_depth=5.5"),
        ("features.spread=true", "features.spread=true"),
    ] {
        assert_eq!(layers.quoted(set), text);
    }
    let args = |set: &str| ConfigArgs {
        set: vec![set.to_owned()],
        ..ConfigArgs::default()
    };
    let off = resolve(&args("static_filter.preset=off")).unwrap();
    assert_eq!(off.static_filter.preset, stillpoint::slam::Preset::Off);
    let e = resolve(&args("static_filter.preset=of"))
        .unwrap_err()
        .to_string();
    for part in ["--set static_filter.preset=of", "`off`", "`paper`"] {
        assert!(e.contains(part), "{e}");
    }
}

/// The error message for `--set` with this argument.
fn refused(set: &str) -> String {
    let args = ConfigArgs {
        set: vec![set.to_owned()],
        ..ConfigArgs::default()
    };
    resolve(&args).unwrap_err().to_string()
}

#[test]
fn suggestion_for_a_mistyped_key_is_of_its_section() {
    let e = refused("features.foo=3");
    assert!(!e.contains("motion_weights"), "{e}");
    assert!(e.contains("did you mean \"features."), "{e}");
    let e = refused("features.feature=3");
    assert!(e.contains("did you mean \"features.features\"?"), "{e}");
    // The section itself is mistyped.
    let e = refused("feature.features=3");
    assert!(e.contains("did you mean \"features.features\"?"), "{e}");
}

#[test]
fn word_instead_of_a_number_is_reported() {
    let e = refused("features.features=ten");
    for part in [
        "--set features.features=ten",
        "expected a whole number for features.features",
        "found a word \"ten\"",
    ] {
        assert!(e.contains(part), "{e}");
    }
    assert!(!e.contains("boolean"), "{e}");
}

#[test]
fn integers_are_accepted_for_floats() {
    let c = layered(&[("sensor.max_depth=6", false)]).unwrap();
    assert_eq!(c.sensor.max_depth, 6.0);
}

#[test]
fn errors_name_location_key_and_remedy() {
    for (text, is_file, parts) in [
        (
            "[tracking]\nmin_inlier = 40\n",
            true,
            &[
                "my.toml:2",
                "tracking.min_inlier\"",
                "\"tracking.min_inliers\"",
            ][..],
        ),
        (
            "min_inliers=4",
            false,
            &["--set min_inliers=4", "\"tracking.min_inliers\""],
        ),
        (
            "tracking.min_inliers=true",
            false,
            &["a whole number", "true or false", "tracking.min_inliers"],
        ),
        (
            "tracking.min_inliers=-5",
            false,
            &["tracking.min_inliers", "-5"],
        ),
        (
            "tracking.min_inliers=4.5",
            false,
            &["a whole number", "4.5"],
        ),
        (
            "motion_weights.persn=4",
            false,
            &["--set motion_weights.persn=4", "`person`", "`persn`"],
        ),
        (
            "motion_weights.person=9",
            false,
            &["motion_weights.person", "0 (ignored) to 5"],
        ),
        ("tracking=4", false, &["found \"tracking\""]),
        ("seed", false, &["--set seed", "TOML"]),
        ("seed=many", false, &["--set seed=many", "quotes"]),
        ("\n\nseed = \n", true, &["my.toml:3"]),
        ("", false, &["no value"]),
    ] {
        let e = layered(&[(text, is_file)]).unwrap_err();
        for part in parts {
            assert!(e.contains(part), "{e:?} lacks {part:?}");
        }
    }
}

proptest::proptest! {
    /// Any configuration file is valid or gives an error that names the file and, except for ranges, the line.
    #[test]
    fn damaged_files_are_valid_or_give_located_errors(
        at in proptest::prelude::any::<proptest::sample::Index>(), cut in 0..12_usize,
        with in proptest::prop_oneof!["[-0-9.ea-z_=\"\\[\\], \n]{0,8}", "\\PC{0,4}"]
    ) {
        let mut text = toml::to_string(&Config::default()).unwrap();
        let at = at.index(text.len());
        text.replace_range(at..(at + cut).min(text.len()), &with);
        let lines = text.lines().count();
        if let Err(message) = layered(&[(&text, true)]) {
            let line = message.strip_prefix("my.toml:").and_then(|rest| rest.split(':').next());
            let line = line.and_then(|l| l.parse::<usize>().ok());
            proptest::prop_assert!(line.is_some_and(|l| (1..=lines + 1).contains(&l)), "{message}");
        }
    }
}

#[test]
fn printed_configuration_round_trips() {
    let mut config = Config {
        seed: 9,
        ..Config::default()
    };
    config.sensor.max_depth = 5.5;
    config.motion_weights.set("dining table", 0.5).unwrap();
    let text = to_text(&config).unwrap();
    assert_eq!(toml::from_str::<Config>(&text).unwrap(), config);
    assert_eq!(layered(&[(&text, true)]).unwrap(), config);
}

#[test]
fn removed_keys_are_refused_with_their_replacement() {
    for (text, is_file, parts) in [
        (
            "mapping.fixed_window=40",
            false,
            &["--set", "mapping.window"][..],
        ),
        (
            "[static_filter]\ndepth = false\n",
            true,
            &["my.toml:2", "static_filter.parts"],
        ),
        (
            "features.levels=4",
            false,
            &["--set", "features.levels", "fixed at 5"],
        ),
        (
            "[objects]\ncoast_seconds = 3.0\n",
            true,
            &["my.toml:2", "objects.coast_seconds", "1.5 s"],
        ),
        ("looping.max_cost=9", false, &["looping.min_odds"]),
        ("looping.min_inliers=20", false, &["looping.min_odds"]),
        (
            "[tracking]\nlocal_radius = 3.0\n",
            true,
            &["my.toml:2", "tracking.local_radius", "fixed"],
        ),
    ] {
        let e = layered(&[(text, is_file)]).unwrap_err();
        for part in parts {
            assert!(e.contains(part), "{e:?} lacks {part:?}");
        }
    }
}

#[test]
fn motion_weights_are_written_only_if_changed() {
    let text = to_text(&Config::default()).unwrap();
    assert!(!text.contains("person ="), "{text}");
    let c = layered(&[
        ("[motion_weights]\nchair = 2\ndining_table = 0\n", true),
        ("motion_weights.chair=1", false),
    ])
    .unwrap();
    let of = |name| c.motion_weights.get(ClassId::from_name(name).unwrap());
    assert_eq!(
        (of("chair"), of("dining table"), of("person")),
        (1.0, 0.0, 5.0)
    );
    let text = to_text(&c).unwrap();
    assert!(
        text.contains("chair = 1.0") && !text.contains("person ="),
        "{text}"
    );
    assert_eq!(layered(&[(&text, true)]).unwrap(), c);
}

#[test]
fn every_setting_is_documented() {
    let table = Layers::new().unwrap().table;
    let mut leaves = Vec::new();
    flatten(&table, None, "", &mut leaves);
    for (path, ..) in leaves {
        // Class names need no explanation, and the section documents the numbers.
        let class = path.starts_with("motion_weights.");
        assert!(
            class || doc_of(&path).is_some(),
            "{path} lacks a line in config/docs.txt"
        );
    }
}
