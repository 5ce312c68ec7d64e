//! Tables as plain text for terminals, and as Markdown for documents.

/// Alignment of a column.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Align {
    /// Words.
    Left,
    /// Numbers.
    #[default]
    Right,
}

/// A table of cells. By default the first column is aligned left, the others right.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Table {
    header: Vec<String>,
    align: Vec<Align>,
    rows: Vec<Vec<String>>,
}

impl Table {
    /// A table without rows.
    #[must_use]
    pub fn new<S: Into<String>>(header: impl IntoIterator<Item = S>) -> Self {
        let header: Vec<String> = header.into_iter().map(Into::into).collect();
        let align = (0..header.len())
            .map(|i| if i == 0 { Align::Left } else { Align::Right })
            .collect();
        Self {
            header,
            align,
            rows: Vec::new(),
        }
    }

    /// Sets a column's alignment; columns that do not exist are ignored.
    #[must_use]
    pub fn align(mut self, column: usize, align: Align) -> Self {
        if let Some(a) = self.align.get_mut(column) {
            *a = align;
        }
        self
    }

    /// Adds a row. Missing cells are empty, excess cells are dropped.
    pub fn row<S: Into<String>>(&mut self, cells: impl IntoIterator<Item = S>) -> &mut Self {
        let mut row: Vec<String> = cells.into_iter().map(Into::into).collect();
        row.resize(self.header.len(), String::new());
        self.rows.push(row);
        self
    }

    /// Whether there is no row.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// The table as GitHub Markdown; it also reads well as text. Ends with a line break.
    #[must_use]
    pub fn to_markdown(&self) -> String {
        let escape = |s: &String| s.replace('|', "\\|").replace('\n', " ");
        let widths = self.widths(escape);
        let mut text = self.line(&self.header, &widths, escape, ("| ", " | ", " |"));
        text.push('|');
        for (width, align) in widths.iter().zip(&self.align) {
            let dashes = "-".repeat(width + 1);
            text += &match align {
                Align::Left => format!("{dashes}-|"),
                Align::Right => format!("{dashes}:|"),
            };
        }
        text.push('\n');
        for row in &self.rows {
            text += &self.line(row, &widths, escape, ("| ", " | ", " |"));
        }
        text
    }

    /// The table as plain text: columns two blanks apart, no trailing blanks. Ends with a line break.
    #[must_use]
    pub fn to_text(&self) -> String {
        let plain = |s: &String| s.replace('\n', " ");
        let widths = self.widths(plain);
        std::iter::once(&self.header)
            .chain(&self.rows)
            .map(|row| {
                let line = self.line(row, &widths, plain, ("", "  ", ""));
                format!("{}\n", line.trim_end())
            })
            .collect()
    }

    /// Width of each column in characters, at least three (the dashes that Markdown requires).
    fn widths(&self, cell: impl Fn(&String) -> String) -> Vec<usize> {
        let width = |i: usize| {
            std::iter::once(&self.header)
                .chain(&self.rows)
                .map(|r| cell(&r[i]).chars().count())
                .fold(3, usize::max)
        };
        (0..self.header.len()).map(width).collect()
    }

    fn line(
        &self,
        row: &[String],
        widths: &[usize],
        cell: impl Fn(&String) -> String,
        (start, between, end): (&str, &str, &str),
    ) -> String {
        let cells: Vec<String> = row
            .iter()
            .zip(widths.iter().zip(&self.align))
            .map(|(text, (width, align))| {
                let text = cell(text);
                match align {
                    Align::Left => format!("{text:<width$}"),
                    Align::Right => format!("{text:>width$}"),
                }
            })
            .collect();
        format!("{start}{}{end}\n", cells.join(between))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_are_written_as_markdown_and_text() {
        let mut t = Table::new(["stage", "ms", "note"]).align(2, Align::Left);
        t.row(["extract", "3.25", "a|b"]).row(["pose", "11.00"]);
        assert_eq!(
            t.to_markdown(),
            "| stage   |    ms | note |\n\
             |---------|------:|------|\n\
             | extract |  3.25 | a\\|b |\n\
             | pose    | 11.00 |      |\n"
        );
        assert_eq!(
            t.to_text(),
            "stage       ms  note\nextract   3.25  a|b\npose     11.00\n"
        );
    }
}
