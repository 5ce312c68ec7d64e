//! `batch.parquet`: the rows as columns, all of them nullable.

use crate::batch::row::Row;
use crate::failure::Failure;
use parquet::basic::{LogicalType, Repetition, Type as Physical};
use parquet::data_type::{ByteArray, ByteArrayType, DataType, DoubleType, Int64Type};
use parquet::errors::Result;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::{SerializedColumnWriter, SerializedFileWriter};
use parquet::schema::types::Type;
use serde_json::{Map, Value};
use std::sync::Arc;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Text,
    Whole,
    Real,
}

/// Columns, named as the fields in `batch.json`.
const COLUMNS: [(&str, Kind); 24] = [
    ("name", Kind::Text),
    ("input", Kind::Text),
    ("folder", Kind::Text),
    ("outcome", Kind::Text),
    ("error", Kind::Text),
    ("attempts", Kind::Whole),
    ("seconds", Kind::Real),
    ("input_bytes", Kind::Whole),
    ("frames", Kind::Whole),
    ("skipped", Kind::Whole),
    ("tracked", Kind::Whole),
    ("tracked_share", Kind::Real),
    ("lost_stretches", Kind::Whole),
    ("submaps", Kind::Whole),
    ("keyframes", Kind::Whole),
    ("landmarks", Kind::Whole),
    ("loops", Kind::Whole),
    ("ate_rmse", Kind::Real),
    ("rpe_rmse", Kind::Real),
    ("peak_memory_bytes", Kind::Whole),
    ("input_sha256", Kind::Text),
    ("stillpoint", Kind::Text),
    ("program_sha256", Kind::Text),
    ("configuration_sha256", Kind::Text),
];

/// The rows as a Parquet file.
///
/// # Errors
/// Rows that cannot be encoded, which would be a bug.
pub(crate) fn to_parquet(rows: &[Row]) -> std::result::Result<Vec<u8>, Failure> {
    let rows: std::result::Result<Vec<Map<String, Value>>, _> = rows
        .iter()
        .map(|row| serde_json::from_value(serde_json::to_value(row)?))
        .collect();
    write(&rows.map_err(Failure::input)?).map_err(Failure::input)
}

fn write(rows: &[Map<String, Value>]) -> Result<Vec<u8>> {
    let fields: Result<Vec<_>> = COLUMNS
        .iter()
        .map(|(name, kind)| {
            let (physical, logical) = match kind {
                Kind::Text => (Physical::BYTE_ARRAY, Some(LogicalType::String)),
                Kind::Whole => (Physical::INT64, None),
                Kind::Real => (Physical::DOUBLE, None),
            };
            let field = Type::primitive_type_builder(name, physical)
                .with_repetition(Repetition::OPTIONAL)
                .with_logical_type(logical);
            Ok(Arc::new(field.build()?))
        })
        .collect();
    let schema = Type::group_type_builder("recordings").with_fields(fields?);
    let properties = Arc::new(WriterProperties::builder().build());
    let mut bytes = Vec::new();
    let mut file = SerializedFileWriter::new(&mut bytes, Arc::new(schema.build()?), properties)?;
    let mut group = file.next_row_group()?;
    for (name, kind) in COLUMNS {
        let Some(mut column) = group.next_column()? else {
            break;
        };
        let cells = rows.iter().map(|r| r.get(name));
        match kind {
            Kind::Text => fill::<ByteArrayType>(&mut column, cells, |v| {
                v.as_str().map(|t| ByteArray::from(t.as_bytes().to_vec()))
            })?,
            Kind::Whole => fill::<Int64Type>(&mut column, cells, Value::as_i64)?,
            Kind::Real => fill::<DoubleType>(&mut column, cells, Value::as_f64)?,
        }
        column.close()?;
    }
    group.close()?;
    file.close()?;
    Ok(bytes)
}

/// Writes a column: its non-null values, and a flag per row whether it has one.
fn fill<'a, T: DataType>(
    column: &mut SerializedColumnWriter<'_>,
    cells: impl Iterator<Item = Option<&'a Value>>,
    of: impl Fn(&Value) -> Option<T::T>,
) -> Result<()> {
    let cells: Vec<Option<T::T>> = cells.map(|cell| cell.and_then(&of)).collect();
    let levels: Vec<i16> = cells.iter().map(|c| i16::from(c.is_some())).collect();
    let values: Vec<T::T> = cells.into_iter().flatten().collect();
    column
        .typed::<T>()
        .write_batch(&values, Some(&levels), None)?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::batch::row::Outcome;
    use crate::batch::row::tests::row;
    use parquet::file::reader::{FileReader, SerializedFileReader};
    use parquet::record::RowAccessor;

    #[test]
    fn columns_match_the_row_fields() {
        let value = serde_json::to_value(row("a", Outcome::Ok, Some(1.0), None)).unwrap();
        let mut fields: Vec<&str> = value
            .as_object()
            .unwrap()
            .keys()
            .map(|k| k.as_str())
            .collect();
        let mut columns: Vec<&str> = COLUMNS.iter().map(|c| c.0).collect();
        fields.sort_unstable();
        columns.sort_unstable();
        assert_eq!(columns, fields);
    }

    #[test]
    fn parquet_file_round_trips_its_rows() {
        let rows = [
            row("a", Outcome::Ok, Some(0.75), Some(0.125)),
            row("\u{fc}", Outcome::Failed, None, None),
        ];
        let bytes = to_parquet(&rows).unwrap();
        let reader = SerializedFileReader::new(bytes::Bytes::from(bytes)).unwrap();
        let read: Vec<_> = reader
            .get_row_iter(None)
            .unwrap()
            .map(|r| r.unwrap())
            .collect();
        assert_eq!(read.len(), 2);
        assert_eq!(read[0].get_string(0).unwrap(), "a");
        assert_eq!(read[1].get_string(0).unwrap(), "\u{fc}");
        assert_eq!(read[1].get_string(4).unwrap(), "a | <reason>");
        assert_eq!(read[0].get_long(5).unwrap(), 1);
        assert_eq!(read[0].get_double(11).unwrap(), 0.75);
        assert_eq!(read[0].get_double(17).unwrap(), 0.125);
        assert!(read[1].get_double(17).is_err());
        to_parquet(&[]).unwrap();
    }
}
