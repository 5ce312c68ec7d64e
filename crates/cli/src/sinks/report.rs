//! `report.html`, unless `--no-report` is given: collects its data during the run.

use crate::failure::Failure;
use crate::sink::{Ended, Output, Sink, Start, Subscription};
use clap::Args;
use std::sync::Arc;
use stillpoint::live::Watch;
use stillpoint::map::MapView;
use stillpoint::slam::{Event, Subscriber};
use stillpoint::view::report::ReportRecorder;

#[derive(Clone, Debug, Default, Args)]
pub(crate) struct ReportOutput {
    /// Do not write report.html into the result folder.
    #[arg(long)]
    pub(crate) no_report: bool,
}

impl Output for ReportOutput {
    fn begin(&self, start: &mut Start<'_>) -> Result<Option<Box<dyn Sink>>, Failure> {
        if self.no_report {
            return Ok(None);
        }
        let mut gathering = Gathering::default();
        if start.known.is_some() {
            gathering.0.begin_with(start.first_keyframe());
        }
        Ok(Some(Box::new(gathering)))
    }

    fn wants_colour(&self) -> bool {
        !self.no_report
    }
}

#[derive(Default)]
pub(crate) struct Gathering(ReportRecorder);

impl Sink for Gathering {
    fn subscribe(&mut self, _: &Arc<MapView>, _: Option<&Watch>) -> Option<Subscription> {
        Some(Subscription::to_images("report", 1))
    }

    fn receive(&mut self, event: &Event) -> Result<(), Failure> {
        let _span = tracing::info_span!("report").entered();
        self.0.receive(event);
        Ok(())
    }

    /// The page covers the whole result, and is written with it.
    fn finish(self: Box<Self>, ended: &mut Ended<'_>) -> Result<(), Failure> {
        ended.found.shelf.put(self.0);
        Ok(())
    }
}
