//! Tries an untrusted model in a separate process before it is loaded in this one. A network's behaviour is only known by running it, and a
//! runtime that exhausts memory, overflows its stack or never ends takes its process with it.

use crate::detector::file::Content;
use crate::detector::network::{Running, load_tried};
use crate::failure::{Failure, Status};
use crate::models::grey::grey;
use std::io::{Read, Write};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use stillpoint::imaging::FrameId;
use stillpoint::inference::sha256_hex;
use stillpoint::models::known_by_sha256;

/// Memory limit of a trial beside [`PER_BYTE`], bytes: two to three times what detectors of some megabytes need for an input of 1280 x 1280
/// px.
const MEMORY: u64 = 850 << 20;
/// Additional memory per byte of the model: it is held as read, as patched and as prepared, for two sizes.
const PER_BYTE: u64 = 12;
/// Address space beyond the memory limit, bytes: libraries, and reservations of threads (glibc: up to 128 MB for the arena of each).
const ADDRESSES: u64 = 5 << 30;
/// CPU time limit of a trial, s, beside one per [`MEGABYTE`] of the model: on small boards a detector of some megabytes takes some seconds
/// for two loads and three runs.
const SECONDS: u64 = 8;
const MEGABYTE: u64 = 1_000_000;
/// Wall clock limit of a trial: several times its CPU time, for busy machines.
const TIME: Duration = Duration::from_secs(60);
/// Polling interval: a twentieth of the elapsed time, at least this and at most twenty times this, as most trials take a fraction of a
/// second.
const PAUSE: Duration = Duration::from_millis(5);

/// Tries a model in a separate process, unless its checksum is that of a known model.
///
/// # Errors
/// The child's error message; a model that kills its process or does not end.
pub(crate) fn check(
    name: &str,
    content: &Content,
    how: &Running,
    option: &str,
) -> Result<(), Failure> {
    // The unit test executable is another program.
    if cfg!(test) || known_by_sha256(&sha256_hex(&content.bytes)).is_some() {
        return Ok(());
    }
    let none = |e: std::io::Error| {
        Failure::input(format!(
            "{option}: expected to start a process to try the model in, found: {e}; end other programs"
        ))
    };
    let mut command = crate::program().map_err(none)?;
    command
        .args(["-q", "models", "check", "--runtime", how.runtime.name()])
        .args(["--threads", &how.options.threads.to_string()])
        .args([&format!("--trial={option}"), "--", name]);
    let trial = Trial::begin(command, content).map_err(none)?;
    let found = match trial.end(TIME).map_err(none)? {
        Ended::Well => return Ok(()),
        Ended::Saying(message) => return Err(Failure::input(message)),
        Ended::Never => format!("one that is not done after {} s", TIME.as_secs()),
        Ended::Dead(status) => format!(
            "one that ends the process that runs it ({status}), as by asking for over {:.1} GB or {} s of a processor, or by a graph that is too deep",
            memory(content.bytes.len()) as f64 * 1e-9,
            seconds(content.bytes.len())
        ),
    };
    Err(Failure::input(format!(
        "{option} {name}: expected a model that can be loaded and run, found {found}; use another one"
    )))
}

struct Trial {
    child: Child,
    /// Collects its stderr.
    said: JoinHandle<String>,
    begun: Instant,
}

#[derive(Debug, PartialEq)]
enum Ended {
    Well,
    Saying(String),
    Dead(ExitStatus),
    Never,
}

impl Trial {
    fn begin(mut command: Command, content: &Content) -> std::io::Result<Self> {
        let begun = Instant::now();
        let mut child = command
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()?;
        let (stdin, stderr) = (child.stdin.take(), child.stderr.take());
        // On its own thread, so that neither pipe fills up while the other is served.
        let said = std::thread::spawn(move || {
            let mut said = Vec::new();
            if let Some(mut pipe) = stderr {
                let _ = (&mut pipe).take(LONGEST).read_to_end(&mut said);
                let _ = std::io::copy(&mut pipe, &mut std::io::sink());
            }
            String::from_utf8_lossy(&said).into_owned()
        });
        if let Some(pipe) = stdin {
            // If the child is gone, its exit status says why.
            let _ = hand_over(pipe, content);
        }
        Ok(Self { child, said, begun })
    }

    fn end(mut self, time: Duration) -> std::io::Result<Ended> {
        let status = loop {
            if let Some(status) = self.child.try_wait()? {
                break status;
            }
            if self.begun.elapsed() > time {
                self.child.kill()?;
                self.child.wait()?;
                return Ok(Ended::Never);
            }
            let pause = (self.begun.elapsed() / 20).clamp(PAUSE, 20 * PAUSE);
            std::thread::sleep(pause);
        };
        let said = self.said.join().unwrap_or_default();
        let message = said.strip_prefix(ERROR).map(str::to_owned).or_else(|| {
            let at = said.find(&format!("\n{ERROR}"))?;
            Some(said[at + 1 + ERROR.len()..].to_owned())
        });
        Ok(match (status.code(), message) {
            (Some(0), _) => Ended::Well,
            (Some(2), Some(message)) => Ended::Saying(message.trim_end().to_owned()),
            _ => Ended::Dead(status),
        })
    }
}

const ERROR: &str = "error: ";
/// Maximum size of such a message, bytes: our longest have some kilobytes.
const LONGEST: u64 = 1 << 16;

/// Sends the card and the model to the child: the lengths of the card's name and text, then name, text and model. Without a card its name
/// is empty.
fn hand_over(mut pipe: impl Write, content: &Content) -> std::io::Result<()> {
    let none = (String::new(), String::new());
    let (name, text) = content.card.as_ref().unwrap_or(&none);
    for part in [name, text] {
        pipe.write_all(&(part.len() as u64).to_le_bytes())?;
    }
    for part in [name.as_bytes(), text.as_bytes(), &content.bytes] {
        pipe.write_all(part)?;
    }
    pipe.flush()
}

/// Receives what [`hand_over`] sends.
fn take(mut pipe: impl Read) -> std::io::Result<Content> {
    let mut length = || -> std::io::Result<u64> {
        let mut bytes = [0; 8];
        pipe.read_exact(&mut bytes)?;
        Ok(u64::from_le_bytes(bytes))
    };
    let lengths = [length()?, length()?];
    let [name, text] = lengths.map(|n| {
        let mut part = String::new();
        let read = (&mut pipe).take(n).read_to_string(&mut part);
        read.map(|_| part)
    });
    let (name, text) = (name?, text?);
    let mut bytes = Vec::new();
    pipe.read_to_end(&mut bytes)?;
    Ok(Content {
        bytes,
        card: (!name.is_empty()).then_some((name, text)),
    })
}

/// Memory limit for a model of this many bytes.
fn memory(bytes: usize) -> u64 {
    MEMORY + PER_BYTE * bytes as u64
}

/// CPU time limit for a model of this many bytes, s.
fn seconds(bytes: usize) -> u64 {
    SECONDS + bytes as u64 / MEGABYTE
}

/// The child process: loads the model from stdin and runs it on an image; the exit status is the result.
pub(crate) fn carry_out(name: &str, how: &Running, option: &str) -> Result<Status, Failure> {
    let content = take(std::io::stdin().lock()).map_err(Failure::input)?;
    let bytes = content.bytes.len();
    limit(memory(bytes), seconds(bytes)).map_err(Failure::input)?;
    let mut network = load_tried(name, &content, how, option)?;
    // An error is reported when the model is used; here it is enough that the process survives.
    let _ = network.detector.detect_image(&grey()?, FrameId(0));
    Ok(Status::Ok)
}

/// Limits memory and CPU time of this process, and disables core dumps.
#[cfg(target_os = "linux")]
fn limit(bytes: u64, seconds: u64) -> std::io::Result<()> {
    use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
    let least = |resource, wanted: u64| {
        let maximum = getrlimit(resource).maximum;
        let wanted = Some(maximum.map_or(wanted, |m| m.min(wanted)));
        setrlimit(
            resource,
            Rlimit {
                current: wanted,
                maximum,
            },
        )
    };
    least(Resource::Core, 0)?;
    least(Resource::Data, bytes)?;
    least(Resource::As, bytes + ADDRESSES)?;
    least(Resource::Cpu, seconds)?;
    Ok(())
}

#[cfg(not(target_os = "linux"))]
fn limit(_: u64, _: u64) -> std::io::Result<()> {
    Ok(())
}

#[cfg(test)]
#[cfg(unix)]
mod tests {
    use super::*;

    fn ended(script: &str, time: Duration) -> Ended {
        let content = Content {
            bytes: vec![7; 300_000],
            card: None,
        };
        let mut command = Command::new("sh");
        command.args(["-c", script]);
        Trial::begin(command, &content).unwrap().end(time).unwrap()
    }

    #[test]
    fn every_way_a_child_process_ends_is_recognised() {
        let long = Duration::from_secs(30);
        assert_eq!(ended("cat > /dev/null", long), Ended::Well);
        // A child that does not even read.
        assert_eq!(ended("exit 0", long), Ended::Well);
        let said = ended(
            "echo 'warning: x' >&2; echo 'error: of\ntwo lines' >&2; exit 2",
            long,
        );
        assert_eq!(said, Ended::Saying("of\ntwo lines".to_owned()));
        for dead in [
            "kill -SEGV $$",
            "exit 2",
            "exit 101",
            "echo 'error: x' >&2; kill -ABRT $$",
        ] {
            assert!(matches!(ended(dead, long), Ended::Dead(_)), "{dead}");
        }
        let endless = "cat > /dev/null; while :; do :; done";
        assert_eq!(ended(endless, Duration::from_millis(50)), Ended::Never);
    }

    /// Environment variable with the limit and the duration of the work of the child process, s.
    const LIMIT: &str = "STILLPOINT_TEST_LIMIT";

    /// The child process of [`time_limit_ends_a_process`]; as a test it does nothing.
    #[test]
    #[cfg(target_os = "linux")]
    fn child_that_works_for_some_time() {
        let Ok(named) = std::env::var(LIMIT) else {
            return;
        };
        let (limited, works) = named.split_once(' ').unwrap();
        limit(memory(0), limited.parse().unwrap()).unwrap();
        let works: f64 = works.parse().unwrap();
        // User and system time of this process, in hundredths of a second, by proc(5).
        let used = || {
            let stat = std::fs::read_to_string("/proc/self/stat").unwrap();
            let fields = stat.rsplit(')').next().unwrap().split_whitespace();
            let ticks = fields.skip(11).take(2).map(|t| t.parse::<f64>().unwrap());
            ticks.sum::<f64>() / 100.0
        };
        while used() < works {}
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn time_limit_ends_a_process() {
        let content = Content {
            bytes: vec![7],
            card: None,
        };
        let ended = |limit: u64, works: &str| {
            let mut command = Command::new(std::env::current_exe().unwrap());
            let name = "models::trial::tests::child_that_works_for_some_time";
            command
                .args(["--exact", name])
                .env(LIMIT, format!("{limit} {works}"));
            let trial = Trial::begin(command, &content).unwrap();
            trial.end(Duration::from_secs(60)).unwrap()
        };
        // Within the limit of a small model, and far beyond one of a second: kernels check the limit only now and then.
        assert_eq!(ended(seconds(1), "1.2"), Ended::Well);
        assert!(matches!(ended(1, "30"), Ended::Dead(_)));
        assert_eq!((seconds(1), seconds(3_500_000)), (8, 11));
    }

    #[test]
    fn model_content_round_trips_through_the_pipe() {
        for card in [None, Some(("a.toml".to_owned(), "x = 1\n".to_owned()))] {
            let content = Content {
                bytes: (0..=255).collect(),
                card,
            };
            let mut pipe = Vec::new();
            hand_over(&mut pipe, &content).unwrap();
            let back = take(&*pipe).unwrap();
            assert_eq!((back.bytes, back.card), (content.bytes, content.card));
        }
        assert!(take(&[1, 2][..]).is_err());
    }
}
