//! Reading a recording into a store.

use crate::MonitorError;
use crate::store::{About, Form, ImageAt, ImageKind, Place, Store};
use axum::body::Bytes;
use mcap::records::Record;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::Path;

/// Newest version of our own layouts that the page reads, `sfg.<Name>.v<number>`.
const NEWEST_VERSION: u32 = 1;

/// What a channel holds.
enum Holds {
    /// JSON of one of our own layouts.
    Json(String),
    Image(Form, String, ImageKind),
    /// Something for other viewers.
    Other,
}

impl Store {
    /// The messages of a recording: `run.mcap`, or the folder of a run. A file that was cut off is read as far as it goes,
    /// and the page says so.
    ///
    /// # Errors
    /// [`MonitorError::Unreadable`] when the file is missing, empty, no recording, that of another program, or of a newer one.
    pub fn open(path: &Path) -> Result<Self, MonitorError> {
        let file = if path.is_dir() { path.join("run.mcap") } else { path.to_owned() };
        read(&file).map_err(|message| MonitorError::Unreadable { path: file, message })
    }
}

fn read(path: &Path) -> Result<Store, String> {
    let bytes = std::fs::read(path).map_err(|error| match error.kind() {
        std::io::ErrorKind::NotFound => {
            "there is no such file; give the folder of a run, as in runs/, or its run.mcap".to_owned()
        }
        _ => error.to_string(),
    })?;
    if bytes.is_empty() {
        return Err("the file is empty: the run ended before anything was written".to_owned());
    }
    let foreign = |why: &str| format!("it is no recording ({why}); give the folder of a run, as in runs/, or its run.mcap");
    let records = mcap::read::ChunkFlattener::new_with_options(&bytes, mcap::read::Options::IgnoreEndMagic.into())
        .map_err(|error| foreign(&error.to_string()))?;
    let folder = path.parent().and_then(Path::file_name).map_or_else(String::new, |name| name.to_string_lossy().into_owned());
    let absolute = std::path::absolute(path).map_err(|error| error.to_string())?;
    let store = Store::of_file(absolute, About { name: folder, ..About::default() });
    let mut schemas: BTreeMap<u16, String> = BTreeMap::new();
    let mut channels: BTreeMap<u16, Holds> = BTreeMap::new();
    let (mut is_ours, mut is_whole, mut n_records) = (false, false, 0_u64);
    for record in records {
        n_records += 1;
        match record {
            Ok(Record::Schema { header, .. }) => drop(schemas.insert(header.id, header.name)),
            Ok(Record::Channel(channel)) => {
                let schema = schemas.get(&channel.schema_id).map_or("", String::as_str);
                let holds = holds(&channel.topic, schema, &channel.message_encoding)?;
                is_ours |= matches!(&holds, Holds::Json(_));
                channels.insert(channel.id, holds);
            }
            Ok(Record::Metadata(metadata)) if metadata.name == "run" => {
                store.edit_about(|about| about.metadata = metadata.metadata);
            }
            Ok(Record::DataEnd(_)) => is_whole = true,
            Ok(Record::Message { header, data }) => {
                let seconds = header.log_time as f64 * 1e-9;
                match channels.get(&header.channel_id) {
                    // A line of the page's stream is a line of text.
                    Some(Holds::Json(topic)) => match compact(&data) {
                        Some(json) => store.push(topic, seconds, &json),
                        None => return Err(format!("a message of {topic} at {seconds:.2} s is no JSON: the file is damaged")),
                    },
                    Some(Holds::Image(form, camera, kind)) => {
                        let place = match data {
                            Cow::Borrowed(data) => Place::File {
                                offset: (data.as_ptr() as usize - bytes.as_ptr() as usize) as u64,
                                n_bytes: data.len(),
                            },
                            Cow::Owned(data) => Place::Memory(Bytes::from(data)),
                        };
                        store.add_image(camera, *kind, seconds, ImageAt::Message(*form, place));
                    }
                    _ => {}
                }
            }
            Ok(_) => {}
            Err(error) if n_records == 1 => return Err(foreign(&error.to_string())),
            // A file that was cut off ends here.
            Err(_) => break,
        }
    }
    if !is_ours && is_whole {
        return Err("it is a recording of another program: it has none of the channels of a run".to_owned());
    }
    if !is_ours {
        return Err("it was cut off before the first message: nothing of the run is in it".to_owned());
    }
    if !is_whole {
        let note = format!("This recording was cut off: it ends at {:.2} s. What is there is shown.", store.end_secs());
        store.edit_about(|about| about.note = Some(note));
    }
    store.sort();
    Ok(store)
}

/// JSON without line ends; as it was where it has none.
fn compact(data: &[u8]) -> Option<Cow<'_, [u8]>> {
    serde_json::from_slice::<serde::de::IgnoredAny>(data).ok()?;
    if !data.iter().any(|byte| matches!(byte, b'\n' | b'\r')) {
        return Some(Cow::Borrowed(data));
    }
    let value: serde_json::Value = serde_json::from_slice(data).ok()?;
    serde_json::to_vec(&value).ok().map(Cow::Owned)
}

fn holds(topic: &str, schema: &str, encoding: &str) -> Result<Holds, String> {
    if let Some(version) = schema.strip_prefix("sfg.").and_then(|name| name.rsplit_once(".v")?.1.parse::<u32>().ok()) {
        if version > NEWEST_VERSION {
            return Err(format!(
                "it was recorded by a newer program: {topic} has the layout {schema} and this program reads version \
                 {NEWEST_VERSION}; show it with the newer sfg"
            ));
        }
        return Ok(if encoding == "json" { Holds::Json(topic.to_owned()) } else { Holds::Other });
    }
    if schema != "foxglove.CompressedImage" {
        return Ok(Holds::Other);
    }
    let form = match encoding {
        "json" => Form::Json,
        "protobuf" => Form::Protobuf,
        _ => return Ok(Holds::Other),
    };
    let mut parts = topic.trim_start_matches('/').split('/');
    Ok(match (parts.next(), parts.next(), parts.next()) {
        (Some("camera"), Some(camera), Some("image")) => Holds::Image(form, camera.to_owned(), ImageKind::Colour),
        (Some("camera"), Some(camera), Some("depth")) => Holds::Image(form, camera.to_owned(), ImageKind::Depth),
        // Older recordings keep the views of the cameras beside the pictures.
        (Some("images"), Some(name @ ("left" | "right")), None) => Holds::Image(form, name.to_owned(), ImageKind::Colour),
        (Some("images"), Some(name), None) => Holds::Image(form, name.to_owned(), ImageKind::Picture),
        _ => Holds::Other,
    })
}
