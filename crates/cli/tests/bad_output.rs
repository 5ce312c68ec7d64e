//! Output that cannot be written ends with a message and exit code 2, and leaves existing files unchanged.

use crate::common::case::Case;
use crate::common::{check, files, program, shell};
use std::path::{Path, PathBuf};

#[test]
fn unwritable_verdicts_and_pictures_are_refused() {
    let case = Case::new();
    let file = case.dir.path().join("file");
    std::fs::write(&file, "mine").unwrap();
    let below = file.join("below");
    let below = below.to_str().unwrap();
    case.fails(
        &["--verdicts", below],
        &["file/below", "another with --verdicts"],
    );
    case.fails(
        &["--overlay", below],
        &["file/below", "another with --overlay"],
    );
    let folder = case.room();
    let folder = folder.to_str().unwrap();
    case.fails(
        &["--verdicts", folder],
        &["room", "another with --verdicts"],
    );
    let file = file.to_str().unwrap();
    case.fails(
        &["--overlay", file],
        &["found a file", "another with --overlay"],
    );
    check(&case.run(&["--overlay-every", "2"]), 2, &["--overlay"]);
    check(
        &case.run(&["--overlay", "x", "--overlay-every", "0"]),
        2,
        &["--overlay-every"],
    );
    if cfg!(target_os = "linux") {
        case.fails(&["--verdicts", "/dev/full"], &["/dev/full", "free space"]);
    }
}

#[test]
fn unwritable_output_is_refused() {
    let case = Case::new();
    let file = case.dir.path().join("file");
    std::fs::write(&file, "mine").unwrap();
    let run = |out: &Path| {
        program()
            .arg("run")
            .arg(case.room())
            .arg("--out")
            .arg(out)
            .output()
            .unwrap()
    };
    check(&run(&file), 2, &["expected a folder", "found a file"]);
    check(
        &run(&file.join("below")),
        2,
        &["expected to write", "file/below"],
    );
    if cfg!(target_os = "linux") {
        // Not even the superuser can write here.
        check(
            &run(Path::new("/proc/stillpoint")),
            2,
            &["expected to write", "/proc/stillpoint"],
        );
    }
    assert_eq!(std::fs::read_to_string(file).unwrap(), "mine");
}

/// A file size limit acts like a full disk: writing fails half-way.
#[test]
#[cfg(unix)]
fn full_disk_keeps_existing_files() {
    let case = Case::new();
    let output = shell(
        "trap '' XFSZ; ulimit -f 1; exec \"$0\" run \"$1\" --out \"$2\"",
        [case.room(), case.out()],
    );
    check(&output, 2, &["expected to write", "free space"]);
    case.old_result_is_untouched();
    // Verdicts are written during the run: the existing file stays, and no other file is left.
    let table = case.dir.path().join("tables/v.csv");
    std::fs::create_dir(case.dir.path().join("tables")).unwrap();
    std::fs::write(&table, "old").unwrap();
    let output = shell(
        "trap '' XFSZ; ulimit -f 300; exec \"$0\" run \"$1\" --out \"$2\" --verdicts \"$3\"",
        [case.room(), case.out(), table.clone()],
    );
    check(&output, 2, &["v.csv: expected to write", "free space"]);
    case.old_result_is_untouched();
    assert_eq!(std::fs::read_to_string(&table).unwrap(), "old");
    assert_eq!(files(&case.dir.path().join("tables")), [table]);
}

/// A reader that closes the pipe causes no panic.
#[test]
#[cfg(unix)]
fn closed_pipe_causes_no_panic() {
    let output = shell(
        "{ \"$0\" config print; echo \"exit $?\" >&2; } | true",
        [""; 0],
    );
    check(&output, 0, &["exit 0"]);
}

#[test]
#[cfg(target_os = "linux")]
fn full_disk_behind_stdout_is_reported() {
    let case = Case::new();
    let room = case.room();
    let room = room.to_str().unwrap();
    let truth = format!("{room}/groundtruth.txt");
    for arguments in [
        "config print",
        "--help",
        "--version",
        "models list",
        &format!("eval {truth} {truth}"),
        &format!("run {room} --max-frames 3 --out {room}/out --json"),
    ] {
        let output = shell(&format!("exec \"$0\" {arguments} > /dev/full"), [""; 0]);
        check(
            &output,
            2,
            &["error: stdout: expected to write", "No space left"],
        );
    }
    assert!(Path::new(room).join("out/summary.json").exists());
}

/// Inputs are never overwritten, whichever output names their path.
#[test]
fn outputs_never_overwrite_the_input() {
    let case = Case::new();
    let data = case.room();
    let held = |folder: &Path| -> Vec<(PathBuf, Vec<u8>)> {
        let files = std::fs::read_dir(folder)
            .unwrap()
            .map(|e| e.unwrap().path());
        let mut files: Vec<PathBuf> = files.filter(|p| p.is_file()).collect();
        files.sort();
        let read = |p: PathBuf| (p.clone(), std::fs::read(p).unwrap());
        files.into_iter().map(read).collect()
    };
    let folders = [data.clone(), data.join("rgb"), data.join("depth")];
    let before = folders.each_ref().map(|f| held(f));
    let [all, rgb, depth] = folders.each_ref().map(|f| f.to_str().unwrap());
    let list = format!("{rgb}/../rgb.txt");
    for (option, path) in [
        ("--masks", all),
        ("--masks", depth),
        ("--overlay", rgb),
        ("--save-map", &list),
        ("--objects", &list),
        ("--record", &list),
    ] {
        case.fails(&[option, path], &["outside of the data set", option]);
    }
    let mut command = program();
    let output = command.arg("run").arg(&data).arg("--out").arg(&data);
    check(
        &output.output().unwrap(),
        2,
        &["outside of the data set for --out"],
    );
    assert_eq!(folders.each_ref().map(|f| held(f)), before);
    // Control: a result may lie beside the images.
    let inner = data.join("result");
    let output = case.run(&[
        "-q",
        "--max-frames",
        "3",
        "--masks",
        inner.to_str().unwrap(),
    ]);
    check(&output, 0, &[]);
    assert_eq!(folders.each_ref().map(|f| held(f)), before);
}

#[test]
#[cfg(unix)]
fn record_refuses_sockets_and_follows_links() {
    use std::os::unix::fs::FileTypeExt;
    let case = Case::new();
    let socket = case.dir.path().join("socket");
    let _listener = std::os::unix::net::UnixListener::bind(&socket).unwrap();
    let path = socket.to_str().unwrap();
    case.fails(&["--record", path], &["a socket", "another name"]);
    let kind = std::fs::symlink_metadata(&socket).unwrap().file_type();
    assert!(kind.is_socket());
    // The target of a link is replaced, not the link.
    let [file, link] = ["walk.mcap", "link.mcap"].map(|n| case.dir.path().join(n));
    std::fs::write(&file, "old").unwrap();
    std::os::unix::fs::symlink(&file, &link).unwrap();
    let output = case.run(&[
        "-q",
        "--max-frames",
        "3",
        "--record",
        link.to_str().unwrap(),
    ]);
    check(&output, 0, &[]);
    assert!(link.is_symlink() && std::fs::metadata(&file).unwrap().len() > 1000);
}

#[test]
fn two_outputs_on_one_path_are_refused() {
    let case = Case::new();
    let file = case.dir.path().join("both");
    std::fs::write(&file, "mine").unwrap();
    let file = file.to_str().unwrap();
    case.fails(
        &["--trace", file, "--save-map", file],
        &[
            "both: expected a path of its own for --trace",
            "that of --save-map",
        ],
    );
    let result = case.out().join("frames.csv");
    case.fails(
        &["--objects", result.to_str().unwrap()],
        &["frames.csv", "a file of the result"],
    );
    assert_eq!(std::fs::read_to_string(file).unwrap(), "mine");
    let map = case.dir.path().join("m.spmap");
    let output = case.run(&[
        "-q",
        "--max-frames",
        "3",
        "--save-map",
        map.to_str().unwrap(),
    ]);
    check(&output, 0, &[]);
    let export = |more: &[&str]| {
        let mut command = program();
        command.args(["map", "export"]).arg(&map).args(more);
        command.output().unwrap()
    };
    let output = export(&["--trajectory", file, "--graph", file]);
    check(&output, 2, &["--graph", "that of --trajectory"]);
    let output = export(&["--graph", map.to_str().unwrap()]);
    check(&output, 2, &["--graph", "that of the map"]);
}
