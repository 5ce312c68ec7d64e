//! The report of a run: one self-contained page.
//!
//! [`ReportRecorder`] collects data during the run, [`RunData`] holds them with the results, and [`to_html`] writes a page that loads
//! nothing else; [`from_html`] reads the data back, to remake the page or compare runs. `page/` holds the browser code that draws it.

mod build;
mod columns;
mod marks;
mod model;
mod recorder;
mod style;
mod thumbnail;
mod verdict;

pub use build::FrameRow;
pub use columns::{Column, Number};
pub use model::{
    FrameColumns, KeyframeColumns, MapColumns, Mark, MarkKind, ObjectColumns, Pictures, RunData,
    Said, SurfaceColumns,
};
pub use recorder::ReportRecorder;
pub use stillpoint_slam::FrameState;
pub use verdict::{Concern, Verdict};

pub(crate) use build::{numbers, triple};
pub(crate) use marks::mark_of;
pub(crate) use recorder::{features, objects_of};
pub(crate) use thumbnail::Thumbnails;

const PAGE: &str = include_str!("page/page.html");
const STYLE: &str = include_str!("page/style.css");
/// In the order of their dependencies.
const SCRIPTS: [&str; 11] = [
    include_str!("page/data.js"),
    include_str!("page/numbers.js"),
    include_str!("page/stages.js"),
    include_str!("page/compare.js"),
    include_str!("page/scene.js"),
    include_str!("page/view3d.js"),
    include_str!("page/plan.js"),
    include_str!("page/timeline.js"),
    include_str!("page/picture.js"),
    include_str!("page/worst.js"),
    include_str!("page/main.js"),
];
/// Entry script of a report, and of a live page.
const REPORT: &str = include_str!("page/report.js");
const LIVE: [&str; 2] = [include_str!("page/live.js"), include_str!("page/feed.js")];
/// Text before and after the data in the page.
const DATA_BEGINS: &str = "<script id=\"data\" type=\"application/json\">";
const DATA_ENDS: &str = "</script>";

/// A page could not be read.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// Not a report, or one of another version.
    #[error(
        "expected a report of a run, found {0}; make it again with the program that is to read it"
    )]
    Page(String),
}

/// The page of one run, or of several side by side.
#[must_use]
pub fn to_html(runs: &[RunData]) -> String {
    let data = serde_json::to_string(runs).unwrap_or_default();
    // Only `<` could end the script element; JSON readers treat its escape alike.
    let data = data.replace('<', "\\u003c");
    let title = match runs {
        [run] => run.name.clone(),
        runs => format!("{} runs", runs.len()),
    };
    page(&title, &data, false)
}

/// The page with its data; a live page only requests updates.
pub(crate) fn page(title: &str, data: &str, is_live: bool) -> String {
    let last: &[&str] = if is_live { &LIVE } else { &[REPORT] };
    let script = [&SCRIPTS[..], last].concat().join("\n");
    let connect = if is_live { "; connect-src 'self'" } else { "" };
    let style = style::style(STYLE);
    let mut page = String::with_capacity(PAGE.len() + style.len() + script.len() + data.len());
    let mut rest = PAGE;
    for (name, text) in [
        ("{{connect}}", connect),
        ("{{title}}", &*escaped(title)),
        ("{{style}}", &*style),
        ("{{data}}", data),
        ("{{script}}", &*script),
    ] {
        let (before, after) = rest.split_once(name).unwrap_or((rest, ""));
        page.push_str(before);
        page.push_str(text);
        rest = after;
    }
    page.push_str(rest);
    page
}

/// The runs of a page.
///
/// # Errors
/// [`ReportError::Page`].
pub fn from_html(page: &str) -> Result<Vec<RunData>, ReportError> {
    let data = page
        .split_once(DATA_BEGINS)
        .and_then(|(_, rest)| rest.split_once(DATA_ENDS));
    let (data, _) = data.ok_or_else(|| ReportError::Page("a page without data".to_owned()))?;
    serde_json::from_str(data).map_err(|e| ReportError::Page(e.to_string()))
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn report_page_round_trips() {
        let run = RunData {
            name: "a </script> & \"b\"".to_owned(),
            summary: serde_json::json!({"frames": 3, "input": "</script><b>"}),
            ..RunData::default()
        };
        let page = to_html(std::slice::from_ref(&run));
        assert!(
            page.contains("<title>a &lt;/script> &amp; &quot;b&quot;"),
            "{}",
            &page[..300]
        );
        // The data element, and the page's own code.
        assert_eq!(page.matches("</script>").count(), 2);
        assert!(!page.contains("{{"), "a place was not filled");
        let back = from_html(&page).unwrap();
        assert_eq!((back.len(), &back[0].name), (1, &run.name));
        assert_eq!(back[0].summary, run.summary);
    }

    #[test]
    fn invalid_report_pages_are_refused() {
        for page in [
            "",
            "<html>",
            "<script id=\"data\" type=\"application/json\">[1]</script>",
        ] {
            assert!(from_html(page).is_err());
        }
    }

    #[test]
    fn report_page_fetches_nothing() {
        let page = to_html(&[RunData::default()]);
        for what in [
            "http://",
            "https://",
            "@import",
            "src=\"",
            "fetch(",
            "XMLHttp",
            "EventSource",
        ] {
            let at = page.find(what);
            assert!(
                at.is_none(),
                "{:?}",
                at.map(|i| &page[i.saturating_sub(60)..i + 60])
            );
        }
    }
}
