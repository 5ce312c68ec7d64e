//! Conversion between Markdown tables and rows of result files.

use crate::results::{Columns, Line};
use crate::table::{Align, Table};

#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Kept {
    pub(crate) columns: Columns,
    pub(crate) rows: Vec<Vec<String>>,
}

impl Kept {
    pub(crate) fn table(&self) -> Table {
        let mut table = Table::new(self.columns.columns.iter().cloned());
        for column in &self.columns.words {
            table = table.align(*column, Align::Left);
        }
        for row in &self.rows {
            table.row(row.iter().cloned());
        }
        table
    }

    pub(crate) fn lines(&self) -> impl Iterator<Item = Line> {
        let rows = self.rows.iter().cloned().map(|cells| Line::Row { cells });
        std::iter::once(Line::Table(self.columns.clone())).chain(rows)
    }
}

fn cells(line: &str) -> Option<Vec<String>> {
    let inner = line.trim().strip_prefix('|')?;
    let inner = inner.strip_suffix('|').unwrap_or(inner);
    let mut cells = vec![String::new()];
    let mut escaped = false;
    for c in inner.chars() {
        match (c, escaped, cells.last_mut()) {
            ('\\', false, _) => escaped = true,
            ('|', false, _) => cells.push(String::new()),
            (c, _, Some(cell)) => {
                // Only bars are escaped in tables.
                if escaped && c != '|' {
                    cell.push('\\');
                }
                cell.push(c);
                escaped = false;
            }
            (_, _, None) => {}
        }
    }
    Some(cells.iter().map(|c| c.trim().to_owned()).collect())
}

/// The columns of a table's first two lines; `None` if they are not a table's.
fn head(line: &str, rule: &str) -> Option<Columns> {
    let (columns, rule) = (cells(line)?, cells(rule)?);
    let is_rule = |c: &String| c.contains('-') && c.chars().all(|c| "-:".contains(c));
    if columns.len() != rule.len() || !rule.iter().all(is_rule) {
        return None;
    }
    let left = rule.iter().enumerate().skip(1);
    let words = left.filter(|(_, c)| !c.ends_with(':')).map(|(i, _)| i);
    Some(Columns {
        columns,
        words: words.collect(),
    })
}

pub(crate) fn tables(text: &str) -> Vec<Kept> {
    let lines: Vec<&str> = text.lines().collect();
    let (mut tables, mut i) = (Vec::new(), 0);
    while i + 1 < lines.len() {
        let Some(columns) = head(lines[i], lines[i + 1]) else {
            i += 1;
            continue;
        };
        let rows: Vec<Vec<String>> = lines[i + 2..].iter().map_while(|l| cells(l)).collect();
        i += 2 + rows.len();
        tables.push(Kept { columns, rows });
    }
    tables
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn table_round_trips_through_markdown() {
        let mut table = Table::new(["scene", "run", "mm"]).align(1, Align::Left);
        table.row(["`a|b`", "x", "1.0"]).row(["c", "", "\\2"]);
        let text = format!("10 seeds\n\n{}\nend | of\n", table.to_markdown());
        let found = tables(&text);
        assert_eq!(found.len(), 1);
        assert_eq!(found[0].columns.words, [1]);
        assert_eq!(found[0].rows[1], ["c", "", "\\2"]);
        assert_eq!(found[0].table(), table);
        assert_eq!(found[0].lines().count(), 3);
    }

    #[test]
    fn compact_and_multiple_tables_are_found() {
        let found = tables("| a | b |\n|---|---:|\n| x | 1 |\n\n| | c |\n|---|---|\n");
        assert_eq!(found.len(), 2);
        assert_eq!(found[0].columns.words, Vec::<usize>::new());
        assert_eq!(
            (found[1].columns.words.clone(), found[1].rows.len()),
            (vec![1], 0)
        );
        assert!(tables("| no | rule |\n| x | y |\n").is_empty());
    }
}
