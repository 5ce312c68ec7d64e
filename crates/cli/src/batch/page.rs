//! `batch.html`: a self-contained page with the worst runs first and links to their reports.

use crate::batch::row::Row;
use crate::batch::table::{Batch, HEADER, cells};
use std::fmt::Write;

const STYLE: &str = "body{font:14px system-ui,sans-serif;margin:2em auto;max-width:70em;padding:0 1em;color:#222;background:#fff}\
table{border-collapse:collapse;width:100%}th,td{padding:.3em .6em;text-align:right;border-bottom:1px solid #ddd}\
th:first-child,td:first-child,th:nth-child(2),td:nth-child(2){text-align:left}tr.failed{background:#fbe3e0}tr.lost{background:#fdf3d7}\
td.why{text-align:left;color:#a22}\
@media(prefers-color-scheme:dark){body{color:#ddd;background:#181818}th,td{border-color:#444}a{color:#8bf}tr.failed{background:#4a2320}tr.lost{background:#453a1a}td.why{color:#f99}}";

/// The page; its links are relative to the batch folder.
pub(crate) fn to_html(batch: &Batch) -> String {
    let (rows, machine) = (batch.by_merit(), &batch.machine);
    let count = |outcome: &str| rows.iter().filter(|r| cells(r)[1] == outcome).count();
    let mut page = format!(
        "<!DOCTYPE html>\n<html lang=\"en\"><meta charset=\"utf-8\"><meta name=\"viewport\" content=\"width=device-width\">\
         <title>{n} recordings</title><style>{STYLE}</style>\n<h1>{n} recordings</h1>\n\
         <p>{ok} went well, {lost} lost frames, {failed} have no result{early}. The worst are on top.</p>\n\
         <p><code>{command}</code><br>Stillpoint {version} on {cpu}, {cores} cores; {workers} at a time, {seconds:.0} s.</p>\n<table><tr>",
        n = rows.len(),
        ok = count("ok"),
        lost = count("lost"),
        failed = count("failed"),
        early = if batch.is_complete {
            ""
        } else {
            "; others are still to be run"
        },
        command = escaped(&batch.command),
        version = escaped(&batch.method.stillpoint),
        cpu = escaped(&machine.cpu),
        cores = machine.cores,
        workers = batch.workers,
        seconds = batch.seconds,
    );
    for head in HEADER {
        let _ = write!(page, "<th>{head}</th>");
    }
    page += "</tr>\n";
    for row in rows {
        add(&mut page, row);
    }
    page + "</table>\n</html>\n"
}

/// Adds a row, linked to its report or, without one, to the messages of its run.
fn add(page: &mut String, row: &Row) {
    let [name, outcome, figures @ ..] = cells(row);
    let file = match row.error {
        Some(_) => "stderr.log",
        None => "report.html",
    };
    let _ = write!(
        page,
        "<tr class=\"{outcome}\"><td><a href=\"{}/{file}\" title=\"{}\">{}</a></td><td>{outcome}</td>",
        address(&row.folder),
        escaped(&row.input),
        escaped(&name)
    );
    match &row.error {
        Some(error) => {
            let _ = write!(
                page,
                "<td class=\"why\" colspan=\"7\">{}</td>",
                escaped(error)
            );
        }
        None => {
            for cell in figures {
                let _ = write!(page, "<td>{cell}</td>");
            }
        }
    }
    *page += "</tr>\n";
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('"', "&quot;")
}

/// Escapes a path for a URL.
fn address(path: &str) -> String {
    let path = path.replace('\\', "/");
    path.bytes().fold(String::new(), |mut text, b| {
        if b.is_ascii_alphanumeric() || b"-._~/".contains(&b) {
            text.push(char::from(b));
        } else {
            let _ = write!(text, "%{b:02X}");
        }
        text
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::batch::merge::tests::batch;
    use crate::batch::row::Outcome;
    use crate::batch::row::tests::row;

    #[test]
    fn worst_runs_come_first_with_links() {
        let rows = vec![
            row("well", Outcome::Ok, Some(1.0), Some(0.01)),
            row("half <b>", Outcome::Lost, Some(0.5), None),
            row("none", Outcome::Failed, None, None),
        ];
        let page = to_html(&batch(None, rows));
        let at = |part: &str| page.find(part).unwrap_or_else(|| panic!("{part}: {page}"));
        assert!(at("none/stderr.log") < at("half%20%3Cb%3E/report.html"));
        assert!(at("half%20%3Cb%3E/report.html") < at("well/report.html"));
        at("a | &lt;reason>");
        at("1 went well, 1 lost frames, 1 have no result");
        assert!(!page.contains("<b>") && !page.contains("http"), "{page}");
    }
}
