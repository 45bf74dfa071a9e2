//! Parquet files from columns.

use super::data::Grasp;
use crate::files::write_whole;
use anyhow::Result;
use parquet::basic::{ConvertedType, LogicalType, Repetition, Type as Physical};
use parquet::data_type::{BoolType, ByteArray, ByteArrayType, DoubleType, FloatType, Int64Type};
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::types::Type;
use std::path::Path;
use std::sync::Arc;

/// The values of one column, one a row.
pub(super) enum Column {
    Text(Vec<String>),
    Bool(Vec<bool>),
    Int(Vec<i64>),
    Float(Vec<f32>),
    Floats(Vec<Vec<f32>>),
    Doubles(Vec<Vec<f64>>),
    Ints(Vec<Vec<i64>>),
    Texts(Vec<Vec<String>>),
}

fn leaf(name: &str, physical: Physical, is_text: bool) -> Result<Arc<Type>> {
    let builder = Type::primitive_type_builder(name, physical).with_repetition(Repetition::REQUIRED);
    let builder = if is_text {
        builder.with_logical_type(Some(LogicalType::String)).with_converted_type(ConvertedType::UTF8)
    } else {
        builder
    };
    Ok(Arc::new(builder.build()?))
}

/// A list of values that are all there.
fn list(name: &str, physical: Physical, is_text: bool) -> Result<Arc<Type>> {
    let items = Type::group_type_builder("list")
        .with_repetition(Repetition::REPEATED)
        .with_fields(vec![leaf("element", physical, is_text)?])
        .build()?;
    let list = Type::group_type_builder(name)
        .with_repetition(Repetition::REQUIRED)
        .with_logical_type(Some(LogicalType::List))
        .with_converted_type(ConvertedType::LIST)
        .with_fields(vec![Arc::new(items)]);
    Ok(Arc::new(list.build()?))
}

impl Column {
    fn schema(&self, name: &str) -> Result<Arc<Type>> {
        match self {
            Self::Text(_) => leaf(name, Physical::BYTE_ARRAY, true),
            Self::Bool(_) => leaf(name, Physical::BOOLEAN, false),
            Self::Int(_) => leaf(name, Physical::INT64, false),
            Self::Float(_) => leaf(name, Physical::FLOAT, false),
            Self::Floats(_) => list(name, Physical::FLOAT, false),
            Self::Doubles(_) => list(name, Physical::DOUBLE, false),
            Self::Ints(_) => list(name, Physical::INT64, false),
            Self::Texts(_) => list(name, Physical::BYTE_ARRAY, true),
        }
    }
}

/// Values of all lists in a row, with Parquet's marks of where a list begins and whether it has a value.
fn flat<T: Clone>(lists: &[Vec<T>]) -> (Vec<T>, Vec<i16>, Vec<i16>) {
    let (mut values, mut defined, mut repeated) = (Vec::new(), Vec::new(), Vec::new());
    for list in lists {
        if list.is_empty() {
            defined.push(0);
            repeated.push(0);
        }
        for (nth, value) in list.iter().enumerate() {
            values.push(value.clone());
            defined.push(1);
            repeated.push(i16::from(nth > 0));
        }
    }
    (values, defined, repeated)
}

/// Writes a file of these columns; `notes` are its key-value metadata.
pub(super) fn write(path: &Path, columns: &[(&str, Column)], notes: &[(&str, String)]) -> Result<()> {
    let fields = columns.iter().map(|(name, column)| column.schema(name)).collect::<Result<Vec<_>>>()?;
    let schema = Arc::new(Type::group_type_builder("schema").with_fields(fields).build()?);
    let notes = notes.iter().map(|(key, value)| KeyValue::new((*key).to_owned(), value.clone())).collect();
    let properties = Arc::new(WriterProperties::builder().set_key_value_metadata(Some(notes)).build());
    let mut bytes = Vec::new();
    let mut writer = SerializedFileWriter::new(&mut bytes, schema, properties)?;
    let mut group = writer.next_row_group()?;
    let text = |text: &String| ByteArray::from(text.as_str());
    for (_, column) in columns {
        let Some(mut open) = group.next_column()? else { break };
        match column {
            Column::Text(values) => {
                let values: Vec<ByteArray> = values.iter().map(text).collect();
                open.typed::<ByteArrayType>().write_batch(&values, None, None)?;
            }
            Column::Bool(values) => drop(open.typed::<BoolType>().write_batch(values, None, None)?),
            Column::Int(values) => drop(open.typed::<Int64Type>().write_batch(values, None, None)?),
            Column::Float(values) => drop(open.typed::<FloatType>().write_batch(values, None, None)?),
            Column::Floats(lists) => {
                let (values, defined, repeated) = flat(lists);
                open.typed::<FloatType>().write_batch(&values, Some(&defined), Some(&repeated))?;
            }
            Column::Doubles(lists) => {
                let (values, defined, repeated) = flat(lists);
                open.typed::<DoubleType>().write_batch(&values, Some(&defined), Some(&repeated))?;
            }
            Column::Ints(lists) => {
                let (values, defined, repeated) = flat(lists);
                open.typed::<Int64Type>().write_batch(&values, Some(&defined), Some(&repeated))?;
            }
            Column::Texts(lists) => {
                let (values, defined, repeated) = flat(lists);
                let values: Vec<ByteArray> = values.iter().map(text).collect();
                open.typed::<ByteArrayType>().write_batch(&values, Some(&defined), Some(&repeated))?;
            }
        }
        open.close()?;
    }
    group.close()?;
    writer.close()?;
    write_whole(path, &bytes)
}

/// Writes one row a grasp.
pub(super) fn write_grasps(path: &Path, grasps: &[Grasp]) -> Result<()> {
    let columns = [
        ("object", Column::Text(grasps.iter().map(|grasp| grasp.object.clone()).collect())),
        ("T_palm", Column::Floats(grasps.iter().map(|grasp| grasp.palm.to_vec()).collect())),
        ("joints", Column::Floats(grasps.iter().map(|grasp| grasp.joints.clone()).collect())),
        ("c1", Column::Float(grasps.iter().map(|grasp| grasp.c[0]).collect())),
        ("c2", Column::Float(grasps.iter().map(|grasp| grasp.c[1]).collect())),
        ("type", Column::Text(grasps.iter().map(|grasp| grasp.grasp_type.clone()).collect())),
        ("label", Column::Bool(grasps.iter().map(|grasp| grasp.label).collect())),
        ("seed", Column::Int(grasps.iter().map(|grasp| grasp.seed).collect())),
    ];
    let notes = [
        ("T_palm", "base_from_palm at the grasp: x, y, z in metres, unit quaternion x, y, z, w".to_owned()),
        ("joints", "arm joints when the hand had closed, radians".to_owned()),
        ("label", "the object came up with the hand".to_owned()),
    ];
    write(path, &columns, &notes)
}
