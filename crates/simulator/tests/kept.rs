//! Cached images: each is rendered once for all processes, and equals the uncached image.

use std::fs;
use std::path::Path;
use std::process::Command;
use stillpoint_simulator::{Simulator, SimulatorConfig};

const INDEX: usize = 3;

fn simulator(frames: usize) -> Simulator {
    let config = SimulatorConfig {
        scene: "walking_xyz".to_owned(),
        frames: Some(frames),
        ..SimulatorConfig::default()
    };
    Simulator::new(&config).unwrap()
}

/// Runs only as a child process, with or without a cache folder.
#[test]
fn child_that_renders() {
    let Some(out) = std::env::var_os("STILLPOINT_TEST_CHILD") else {
        return;
    };
    // Recordings of different lengths, and both functions.
    let (short, long) = (simulator(4), simulator(9));
    let frame = short.frame_with_colour(INDEX);
    assert_eq!(frame.gray, long.frame(INDEX).gray);
    assert_eq!(frame.depth, long.depth(INDEX));
    let mut bytes = frame.colour.unwrap().data().to_vec();
    bytes.extend(frame.depth.data().iter().flat_map(|z| z.to_le_bytes()));
    fs::write(out, bytes).unwrap();
}

/// Runs a rendering process; returns its images.
fn child(scenes: Option<&Path>) -> Vec<u8> {
    let out = tempfile::NamedTempFile::new().unwrap();
    let mut command = Command::new(std::env::current_exe().unwrap());
    command.args(["--exact", "kept::child_that_renders"]);
    command.env("STILLPOINT_TEST_CHILD", out.path());
    match scenes {
        Some(folder) => command.env("STILLPOINT_SCENES", folder),
        None => command.env_remove("STILLPOINT_SCENES"),
    };
    let output = command.output().unwrap();
    assert!(output.status.success(), "{output:?}");
    fs::read(out.path()).unwrap()
}

/// Whether the CI gate accepts the rendered images.
fn gate_accepts(scenes: &Path) -> bool {
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/../../.ci/twice");
    let mut command = Command::new("bash");
    let command = command.arg(script).arg(scenes.join("rendered"));
    let status = command.output().unwrap().status;
    status.code().unwrap() == 0
}

#[test]
fn cached_image_is_rendered_once_across_processes() {
    let folder = tempfile::tempdir().unwrap();
    let scenes = folder.path();
    let without = child(None);
    let together = std::thread::scope(|scope| {
        let children = [0, 1].map(|_| scope.spawn(|| child(Some(scenes))));
        children.map(|c| c.join().unwrap())
    });
    for with in together.into_iter().chain([child(Some(scenes))]) {
        assert!(
            with == without,
            "what is kept differs from what is rendered"
        );
    }
    let rendered = || fs::read_to_string(scenes.join("rendered")).unwrap();
    assert_eq!(rendered().lines().count(), 2, "{}", rendered());
    assert!(gate_accepts(scenes));
    // Control: a lost image is rendered again, which is detected.
    let folders = fs::read_dir(scenes).unwrap().map(|e| e.unwrap().path());
    let folder = folders.into_iter().find(|path| path.is_dir()).unwrap();
    fs::remove_file(folder.join(format!("{INDEX}.colour"))).unwrap();
    assert!(child(Some(scenes)) == without);
    assert_eq!(rendered().lines().count(), 3, "{}", rendered());
    assert!(!gate_accepts(scenes));
}
