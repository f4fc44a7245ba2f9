use std::fs::File;
use std::io;
use std::path::Path;
use std::sync::Arc;

use parquet::basic::{LogicalType, Repetition, Type as Physical};
use parquet::data_type::{BoolType, ByteArray, ByteArrayType, DataType, DoubleType, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::{SerializedColumnWriter, SerializedFileWriter};
use parquet::schema::types::{Type, TypePtr};
use serde_json::Value;

use super::tables::{Column, Kind, Table};

/// Rows of a row group, which is buffered in memory until it is written.
const GROUP_ROWS: usize = 1 << 16;

/// Apache Parquet file, uncompressed, with every column optional.
pub(super) struct ParquetFile {
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

    pub fn row(&mut self, row: &[Value]) -> io::Result<()> {
        self.rows.push(row.to_vec());
        if self.rows.len() < GROUP_ROWS { Ok(()) } else { Ok(self.write_group()?) }
    }

    /// Writes buffered rows and closes the file.
    pub fn finish(mut self) -> io::Result<()> {
        if !self.rows.is_empty() {
            self.write_group()?;
        }
        self.file.close()?;
        Ok(())
    }

    fn write_group(&mut self) -> Result<(), ParquetError> {
        let mut group = self.file.next_row_group()?;
        for (index, Column(_, kind, _)) in self.table.columns.iter().enumerate() {
            let Some(mut column) = group.next_column()? else { break };
            let values: Vec<&Value> = self.rows.iter().filter_map(|row| row.get(index)).collect();
            match kind {
                Kind::Whole => write::<Int64Type>(&mut column, &values, Value::as_i64)?,
                Kind::Real => write::<DoubleType>(&mut column, &values, Value::as_f64)?,
                Kind::Flag => write::<BoolType>(&mut column, &values, Value::as_bool)?,
                Kind::Text => {
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

/// Writes a column: the definition level of each row is 1 where it has a value.
fn write<T: DataType>(
    column: &mut SerializedColumnWriter<'_>,
    values: &[&Value],
    of: impl Fn(&Value) -> Option<T::T>,
) -> Result<(), ParquetError> {
    let levels: Vec<i16> = values.iter().map(|value| i16::from(!value.is_null())).collect();
    let present: Vec<T::T> = values.iter().filter_map(|value| of(value)).collect();
    column.typed::<T>().write_batch(&present, Some(&levels), None).map(drop)
}

fn schema(table: &Table) -> Result<TypePtr, ParquetError> {
    let field = |Column(name, kind, _): &Column| {
        let (physical, logical) = match kind {
            Kind::Whole => (Physical::INT64, None),
            Kind::Real => (Physical::DOUBLE, None),
            Kind::Flag => (Physical::BOOLEAN, None),
            Kind::Text => (Physical::BYTE_ARRAY, Some(LogicalType::String)),
        };
        let field = Type::primitive_type_builder(name, physical).with_repetition(Repetition::OPTIONAL);
        field.with_logical_type(logical).build().map(Arc::new)
    };
    let fields = table.columns.iter().map(field).collect::<Result<_, _>>()?;
    Type::group_type_builder(&table.name).with_fields(fields).build().map(Arc::new)
}
