use std::fs::File;
use std::io;
use std::path::Path;
use std::slice;
use std::sync::Arc;

use parquet::basic::{LogicalType, Repetition, Type as Physical};
use parquet::data_type::{BoolType, ByteArray, ByteArrayType, DataType, DoubleType, FloatType, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::{SerializedColumnWriter, SerializedFileWriter};
use parquet::schema::types::{Type, TypePtr};
use serde_json::Value;

use super::tables::{Column, Kind, Table};

/// Rows of a row group that ends by itself.
const GROUP_ROWS: usize = 1 << 16;

/// Apache Parquet file, uncompressed. Values that are no list are optional.
pub(crate) struct ParquetFile {
    file: SerializedFileWriter<File>,
    table: &'static Table,
    rows: Vec<Vec<Value>>,
}

impl ParquetFile {
    pub fn create(path: &Path, table: &'static Table) -> io::Result<Self> {
        let schema = schema(table)?;
        let file = SerializedFileWriter::new(File::create(path)?, schema, Arc::new(WriterProperties::default()))?;
        Ok(Self { file, table, rows: Vec::new() })
    }

    /// Appends rows to the present row group, which is in memory until it ends.
    pub fn rows(&mut self, rows: impl IntoIterator<Item = Vec<Value>>) {
        self.rows.extend(rows);
    }

    /// Appends a row, and ends the row group once it has [`GROUP_ROWS`].
    pub fn row(&mut self, row: Vec<Value>) -> io::Result<()> {
        self.rows.push(row);
        if self.rows.len() < GROUP_ROWS { Ok(()) } else { self.end_group() }
    }

    /// Adds text about the file to its metadata.
    pub fn note(&mut self, key: &str, text: String) {
        self.file.append_key_value_metadata(KeyValue::new(key.to_owned(), text));
    }

    /// Writes the last row group and closes the file.
    pub fn finish(&mut self) -> io::Result<()> {
        if !self.rows.is_empty() {
            self.end_group()?;
        }
        self.file.finish()?;
        Ok(())
    }

    /// Writes the present row group.
    pub fn end_group(&mut self) -> io::Result<()> {
        let mut group = self.file.next_row_group()?;
        for (index, Column(_, kind, _)) in self.table.columns.iter().enumerate() {
            let Some(mut column) = group.next_column()? else { break };
            let values: Vec<&Value> = self.rows.iter().filter_map(|row| row.get(index)).collect();
            match kind {
                Kind::Integer | Kind::Integers => write::<Int64Type>(&mut column, &values, Value::as_i64)?,
                Kind::Number | Kind::Numbers => write::<DoubleType>(&mut column, &values, Value::as_f64)?,
                Kind::Single | Kind::Singles => {
                    write::<FloatType>(&mut column, &values, |value| value.as_f64().map(|value| value as f32))?
                }
                Kind::Boolean => write::<BoolType>(&mut column, &values, Value::as_bool)?,
                Kind::String | Kind::Strings => {
                    write::<ByteArrayType>(&mut column, &values, |value| value.as_str().map(ByteArray::from))?
                }
            }
            column.close()?;
        }
        group.close()?;
        self.rows.clear();
        Ok(())
    }
}

/// Writes a column: the definition level of each value is 1 where there is one, its repetition level 1 within a list.
fn write<T: DataType>(
    column: &mut SerializedColumnWriter<'_>,
    values: &[&Value],
    of: impl Fn(&Value) -> Option<T::T>,
) -> Result<(), ParquetError> {
    let (mut present, mut defined, mut repeated) = (Vec::new(), Vec::new(), Vec::new());
    for value in values {
        for (index, item) in value.as_array().map_or(slice::from_ref(*value), Vec::as_slice).iter().enumerate() {
            defined.push(i16::from(!item.is_null()));
            repeated.push(i16::from(index > 0));
            present.extend(of(item));
        }
    }
    column.typed::<T>().write_batch(&present, Some(&defined), Some(&repeated)).map(drop)
}

fn schema(table: &Table) -> Result<TypePtr, ParquetError> {
    let field = |Column(name, kind, _): &Column| {
        let (physical, logical) = match kind {
            Kind::Integer | Kind::Integers => (Physical::INT64, None),
            Kind::Number | Kind::Numbers => (Physical::DOUBLE, None),
            Kind::Single | Kind::Singles => (Physical::FLOAT, None),
            Kind::Boolean => (Physical::BOOLEAN, None),
            Kind::String | Kind::Strings => (Physical::BYTE_ARRAY, Some(LogicalType::String)),
        };
        let of = |name| Type::primitive_type_builder(name, physical).with_logical_type(logical.clone());
        if !matches!(kind, Kind::Integers | Kind::Numbers | Kind::Singles | Kind::Strings) {
            return of(name).with_repetition(Repetition::OPTIONAL).build().map(Arc::new);
        }
        let item = of("element").with_repetition(Repetition::REQUIRED).build()?;
        let items = Type::group_type_builder("list").with_repetition(Repetition::REPEATED);
        let items = items.with_fields(vec![Arc::new(item)]).build()?;
        let list = Type::group_type_builder(name).with_repetition(Repetition::REQUIRED);
        list.with_logical_type(Some(LogicalType::List)).with_fields(vec![Arc::new(items)]).build().map(Arc::new)
    };
    let fields = table.columns.iter().map(field).collect::<Result<_, _>>()?;
    Type::group_type_builder(&table.name).with_fields(fields).build().map(Arc::new)
}
