//! `datasets pull` and `bench --suite --pull`: sequences from their official pages.

use crate::args::datasets::PullArgs;
use crate::bench::suite::catalogue::Suite;
use crate::console;
use crate::datasets::catalogue::{Sequence, named};
use crate::download::{Bar, about, came, megabytes};
use crate::failure::{Failure, Status};
use crate::interrupt::Interrupt;
use std::ops::ControlFlow;
use std::path::Path;
use stillpoint::fetch::archive::{self, Archive, Pulled};
use stillpoint::fetch::{Progress, RealDisk, Waits, shown_address};

/// A list of frames, which every sequence has.
const HOLDS: &str = "rgb.txt";

pub(crate) fn pull(args: &PullArgs) -> Result<Status, Failure> {
    let sequences = named(&args.name)?;
    let interrupt = Interrupt::listen();
    let mirror = args.mirror.as_deref();
    for sequence in &sequences {
        let pulled = one(*sequence, &args.dir, mirror, &interrupt)?;
        console::report(&text(*sequence, &pulled, mirror));
    }
    console::report(&match (&sequences[..], args.dir.display()) {
        ([one], dir) => format!("`stillpoint run {dir}/{}` runs it\n", one.folder()),
        (all, dir) => {
            let suite = all.first().map_or("", |s| s.suite.name());
            format!("`stillpoint bench --suite {suite} {dir}` runs them\n")
        }
    });
    Ok(Status::Ok)
}

/// Downloads the given sequences of a suite into a folder, one after the other. Ends at the first failure and keeps partial downloads.
pub(crate) fn missing(
    suite: Suite,
    is_missing: impl Fn(Sequence) -> bool,
    (dir, mirror): (&Path, Option<&str>),
    interrupt: &Interrupt,
) -> Result<(), Failure> {
    for sequence in Sequence::of(suite).filter(|s| is_missing(*s)) {
        let pulled = one(sequence, dir, mirror, interrupt)?;
        console::info(text(sequence, &pulled, mirror).trim_end());
    }
    Ok(())
}

fn one(
    sequence: Sequence,
    dir: &Path,
    mirror: Option<&str>,
    interrupt: &Interrupt,
) -> Result<Pulled, Failure> {
    let (address, file, folder) = (sequence.address(mirror), sequence.file(), sequence.folder());
    let origin = sequence.suite.origin();
    let archive = Archive {
        address: &address,
        file: &file,
        folder: &folder,
        holds: HOLDS,
        packing: origin.packing,
        sha256: None,
        waits: Waits::default(),
    };
    let mut shown = Shown::default();
    let result = archive::pull(&archive, dir, &RealDisk, &mut |progress| {
        shown.show(sequence, progress);
        match interrupt.requested() {
            true => ControlFlow::Break(()),
            false => ControlFlow::Continue(()),
        }
    });
    shown.bar.finish();
    result.map_err(|e| match e.is_stopped() {
        true => Failure::criteria(e),
        false => Failure::input(e),
    })
}

#[derive(Default)]
struct Shown {
    bar: Bar,
    size: bool,
    unpacking: bool,
}

impl Shown {
    fn show(&mut self, sequence: Sequence, progress: Progress) {
        let origin = sequence.suite.origin();
        match progress {
            Progress::Connecting { url } => {
                let (licence, page) = (origin.licence, origin.page);
                console::info(&format!("{url}\nlicence: {licence} ({page})"));
            }
            Progress::Receiving {
                received,
                total,
                resumed,
            } => {
                if !std::mem::replace(&mut self.size, true) {
                    console::info(&size(total));
                }
                self.bar.receiving(received, total, resumed);
            }
            Progress::Unpacking { done, total } => {
                if !std::mem::replace(&mut self.unpacking, true) {
                    self.bar.finish();
                    console::info(&format!("unpacking {}", sequence.file()));
                }
                self.bar.receiving(done, Some(total), 0);
            }
            _ => {}
        }
    }
}

/// The file size as stated by the server.
fn size(total: Option<u64>) -> String {
    match total {
        Some(bytes) => format!("size: {}", megabytes(bytes)),
        None => "size: not known, the server does not say".to_owned(),
    }
}

fn text(sequence: Sequence, pulled: &Pulled, mirror: Option<&str>) -> String {
    let url = shown_address(&sequence.address(mirror));
    let mut text = format!(
        "{}: {}, in {}\n",
        sequence.name(),
        came(pulled.transferred, pulled.resumed, &url),
        pulled.folder.display()
    );
    if let Some((sha256, checksum)) = &pulled.sha256 {
        let record = pulled.record.display();
        text += &format!("SHA-256 {sha256} ({}; {record})\n", about(*checksum));
    }
    text
}
