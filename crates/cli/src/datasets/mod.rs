//! `datasets`: lists and downloads sequences of public data sets.

pub(crate) mod catalogue;
pub(crate) mod pull;

use crate::args::datasets::DatasetsCommand;
use crate::bench::suite::catalogue::Suite;
use crate::console;
use crate::datasets::catalogue::Sequence;
use crate::failure::{Failure, Status};
use clap::ValueEnum;
use stillpoint::evaluation::{Align, Table};

pub(crate) fn datasets(command: &DatasetsCommand) -> Result<Status, Failure> {
    match command {
        DatasetsCommand::List(_) => {
            console::print(&list());
            Ok(Status::Ok)
        }
        DatasetsCommand::Pull(a) => pull::pull(a),
    }
}

fn list() -> String {
    let mut table = Table::new(["sequence", "suite", "folder"])
        .align(1, Align::Left)
        .align(2, Align::Left);
    for sequence in Sequence::all() {
        table.row([
            sequence.name(),
            sequence.suite.name().to_owned(),
            sequence.folder(),
        ]);
    }
    let mut text = table.to_text() + "\n";
    for suite in Suite::value_variants() {
        let origin = suite.origin();
        text += &format!(
            "{}: {}, licence: {}\n",
            suite.name(),
            origin.page,
            origin.licence
        );
    }
    text + "\n`stillpoint datasets pull NAME` gets a sequence, or all of a suite; sizes are the server's, and shown before the download\n"
}
