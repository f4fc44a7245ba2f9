use std::fs::File;
use std::io;
use std::path::Path;
use std::sync::Arc;

use parquet::basic::{LogicalType, Repetition, Type as Physical};
use parquet::data_type::{BoolType, ByteArray, ByteArrayType, DoubleType, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::{SerializedColumnWriter, SerializedFileWriter};
use parquet::schema::types::{Type, TypePtr};

use super::table::{Column, ExportTable, Kind, TableCell, TableFile};

/// Rows of a row group, which is buffered in memory until it is written.
const GROUP_ROWS: usize = 1 << 16;

/// Apache Parquet file, uncompressed, with every column optional.
pub(super) struct ParquetFile {
    file: SerializedFileWriter<File>,
    columns: Vec<Values>,
    rows: usize,
}

/// Buffered values of a column, one entry per row.
enum Values {
    Whole(Vec<Option<i64>>),
    Real(Vec<Option<f64>>),
    Flag(Vec<Option<bool>>),
    Text(Vec<Option<ByteArray>>),
}

impl ParquetFile {
    pub fn create(path: &Path, table: &ExportTable) -> io::Result<Self> {
        let schema = schema(table).map_err(io::Error::other)?;
        let file = SerializedFileWriter::new(File::create(path)?, schema, Arc::new(WriterProperties::default()));
        let columns = table.columns.iter().map(|Column(_, kind)| Values::of(*kind)).collect();
        Ok(Self { file: file.map_err(io::Error::other)?, columns, rows: 0 })
    }

    fn write_group(&mut self) -> Result<(), ParquetError> {
        let mut group = self.file.next_row_group()?;
        for values in &mut self.columns {
            if let Some(mut column) = group.next_column()? {
                values.write(&mut column)?;
                column.close()?;
            }
        }
        group.close()?;
        self.rows = 0;
        Ok(())
    }
}

impl TableFile for ParquetFile {
    fn row(&mut self, cells: &[TableCell<'_>]) -> io::Result<()> {
        self.columns.iter_mut().zip(cells).for_each(|(values, cell)| values.push(cell));
        self.rows += 1;
        if self.rows < GROUP_ROWS { Ok(()) } else { self.write_group().map_err(io::Error::other) }
    }

    fn finish(mut self: Box<Self>) -> io::Result<()> {
        if self.rows > 0 {
            self.write_group().map_err(io::Error::other)?;
        }
        self.file.close().map(|_| ()).map_err(io::Error::other)
    }
}

impl Values {
    fn of(kind: Kind) -> Self {
        match kind {
            Kind::Whole => Self::Whole(Vec::new()),
            Kind::Real => Self::Real(Vec::new()),
            Kind::Flag => Self::Flag(Vec::new()),
            Kind::Text => Self::Text(Vec::new()),
        }
    }

    /// Appends a cell; one of another kind is stored as empty.
    fn push(&mut self, cell: &TableCell<'_>) {
        match (self, cell) {
            (Self::Whole(values), TableCell::Whole(value)) => values.push(Some(*value)),
            (Self::Real(values), TableCell::Real(value)) => values.push(Some(*value)),
            (Self::Flag(values), TableCell::Flag(value)) => values.push(Some(*value)),
            (Self::Text(values), TableCell::Text(value)) => values.push(Some(ByteArray::from(*value))),
            (Self::Whole(values), _) => values.push(None),
            (Self::Real(values), _) => values.push(None),
            (Self::Flag(values), _) => values.push(None),
            (Self::Text(values), _) => values.push(None),
        }
    }

    /// Writes the values and clears the buffer.
    fn write(&mut self, column: &mut SerializedColumnWriter<'_>) -> Result<(), ParquetError> {
        match self {
            Self::Whole(values) => {
                let (levels, present) = split(values);
                column.typed::<Int64Type>().write_batch(&present, Some(&levels), None)
            }
            Self::Real(values) => {
                let (levels, present) = split(values);
                column.typed::<DoubleType>().write_batch(&present, Some(&levels), None)
            }
            Self::Flag(values) => {
                let (levels, present) = split(values);
                column.typed::<BoolType>().write_batch(&present, Some(&levels), None)
            }
            Self::Text(values) => {
                let (levels, present) = split(values);
                column.typed::<ByteArrayType>().write_batch(&present, Some(&levels), None)
            }
        }
        .map(|_| ())
    }
}

/// Definition level of each row (1 where it has a value), and the values present; empties `values`.
fn split<T>(values: &mut Vec<Option<T>>) -> (Vec<i16>, Vec<T>) {
    let levels = values.iter().map(|value| i16::from(value.is_some())).collect();
    (levels, values.drain(..).flatten().collect())
}

fn schema(table: &ExportTable) -> Result<TypePtr, ParquetError> {
    let field = |Column(name, kind): &Column| {
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
    Type::group_type_builder(table.name).with_fields(fields).build().map(Arc::new)
}
