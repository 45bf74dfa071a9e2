//! A LeRobotDataset v3.0: states and actions, without video.

use super::data::Episode;
use super::table::{Column, write};
use crate::check::BadInput;
use crate::files::write_whole;
use anyhow::Result;
use serde_json::{Value, json};
use std::path::Path;

/// Rate of `/robot`.
const FPS: u32 = 100;

/// Writes the data set into `folder`.
pub(super) fn write_dataset(folder: &Path, episodes: &[Episode]) -> Result<()> {
    let Some(first) = episodes.first() else { return Ok(()) };
    if episodes.iter().any(|episode| episode.names != first.names) {
        let message = "the runs are of robots with other joints; export them one by one";
        return Err(BadInput(message.to_owned()).into());
    }
    let mut tasks: Vec<&str> = Vec::new();
    let mut task_of = Vec::new();
    for episode in episodes {
        let known = tasks.iter().position(|task| *task == episode.task);
        task_of.push(known.unwrap_or_else(|| {
            tasks.push(&episode.task);
            tasks.len() - 1
        }));
    }
    write_data(folder, episodes, &task_of)?;
    write_episodes(folder, episodes)?;
    // The sentence is the index of the table, as pandas writes it.
    let pandas = json!({
        "index_columns": ["task"],
        "column_indexes": [],
        "columns": [
            {"name": "task_index", "field_name": "task_index", "pandas_type": "int64", "numpy_type": "int64", "metadata": null},
            {"name": "task", "field_name": "task", "pandas_type": "unicode", "numpy_type": "object", "metadata": null},
        ],
        "pandas_version": "2.2.0",
    });
    let columns = [
        ("task_index", Column::Int((0..tasks.len() as i64).collect())),
        ("task", Column::Text(tasks.iter().map(|task| (*task).to_owned()).collect())),
    ];
    write(&folder.join("meta/tasks.parquet"), &columns, &[("pandas", pandas.to_string())])?;
    let stats = json!({
        "observation.state": statistics(episodes.iter().flat_map(|episode| &episode.states)),
        "action": statistics(episodes.iter().flat_map(|episode| &episode.actions)),
    });
    write_whole(&folder.join("meta/stats.json"), &serde_json::to_vec_pretty(&stats)?)?;
    write_whole(&folder.join("meta/info.json"), &serde_json::to_vec_pretty(&info(episodes, tasks.len()))?)
}

fn info(episodes: &[Episode], n_tasks: usize) -> Value {
    let vector = |names: &[String]| json!({"dtype": "float32", "shape": [names.len()], "names": names});
    let scalar = |dtype: &str| json!({"dtype": dtype, "shape": [1], "names": null});
    let [state, action] = episodes.first().map(|episode| episode.names.clone()).unwrap_or_default();
    json!({
        "codebase_version": "v3.0",
        "robot_type": "sfg",
        "total_episodes": episodes.len(),
        "total_frames": episodes.iter().map(|episode| episode.states.len()).sum::<usize>(),
        "total_tasks": n_tasks,
        "chunks_size": 1000,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 500,
        "fps": FPS,
        "splits": {"train": format!("0:{}", episodes.len())},
        "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
        "video_path": null,
        "features": {
            "observation.state": vector(&state),
            "action": vector(&action),
            "timestamp": scalar("float32"),
            "frame_index": scalar("int64"),
            "episode_index": scalar("int64"),
            "index": scalar("int64"),
            "task_index": scalar("int64"),
        },
    })
}

fn write_data(folder: &Path, episodes: &[Episode], task_of: &[usize]) -> Result<()> {
    let frames =
        || episodes.iter().enumerate().flat_map(|(nth, episode)| (0..episode.states.len()).map(move |frame| (nth, frame)));
    let columns = [
        ("observation.state", Column::Floats(episodes.iter().flat_map(|episode| episode.states.clone()).collect())),
        ("action", Column::Floats(episodes.iter().flat_map(|episode| episode.actions.clone()).collect())),
        ("timestamp", Column::Float(frames().map(|(_, frame)| frame as f32 / FPS as f32).collect())),
        ("frame_index", Column::Int(frames().map(|(_, frame)| frame as i64).collect())),
        ("episode_index", Column::Int(frames().map(|(nth, _)| nth as i64).collect())),
        ("index", Column::Int((0..frames().count() as i64).collect())),
        ("task_index", Column::Int(frames().map(|(nth, _)| task_of[nth] as i64).collect())),
    ];
    write(&folder.join("data/chunk-000/file-000.parquet"), &columns, &[])
}

fn write_episodes(folder: &Path, episodes: &[Episode]) -> Result<()> {
    let lengths: Vec<i64> = episodes.iter().map(|episode| episode.states.len() as i64).collect();
    let ends: Vec<i64> = lengths
        .iter()
        .scan(0, |sum, length| {
            *sum += length;
            Some(*sum)
        })
        .collect();
    let starts = ends.iter().zip(&lengths).map(|(end, length)| end - length).collect();
    let zeros = || Column::Int(vec![0; episodes.len()]);
    let mut columns = vec![
        ("episode_index".to_owned(), Column::Int((0..episodes.len() as i64).collect())),
        ("tasks".to_owned(), Column::Texts(episodes.iter().map(|episode| vec![episode.task.clone()]).collect())),
        ("length".to_owned(), Column::Int(lengths.clone())),
        ("data/chunk_index".to_owned(), zeros()),
        ("data/file_index".to_owned(), zeros()),
        ("dataset_from_index".to_owned(), Column::Int(starts)),
        ("dataset_to_index".to_owned(), Column::Int(ends)),
        ("meta/episodes/chunk_index".to_owned(), zeros()),
        ("meta/episodes/file_index".to_owned(), zeros()),
    ];
    for (feature, rows) in [("observation.state", 0), ("action", 1)] {
        let of = |episode: &Episode| summary(if rows == 0 { &episode.states } else { &episode.actions });
        for (which, name) in ["min", "max", "mean", "std"].into_iter().enumerate() {
            let values = episodes.iter().map(|episode| of(episode)[which].clone()).collect();
            columns.push((format!("stats/{feature}/{name}"), Column::Doubles(values)));
        }
        columns.push((format!("stats/{feature}/count"), Column::Ints(lengths.iter().map(|length| vec![*length]).collect())));
    }
    let columns: Vec<(&str, Column)> =
        columns.iter_mut().map(|(name, column)| (name.as_str(), std::mem::replace(column, Column::Int(Vec::new())))).collect();
    write(&folder.join("meta/episodes/chunk-000/file-000.parquet"), &columns, &[])
}

/// Smallest, largest, mean and standard deviation of each value.
fn summary<'a>(rows: impl IntoIterator<Item = &'a Vec<f32>>) -> [Vec<f64>; 4] {
    let (mut n, mut found): (f64, [Vec<f64>; 4]) = (0.0, Default::default());
    let mut squares: Vec<f64> = Vec::new();
    for row in rows {
        if n == 0.0 {
            found =
                [vec![f64::INFINITY; row.len()], vec![f64::NEG_INFINITY; row.len()], vec![0.0; row.len()], vec![0.0; row.len()]];
            squares = vec![0.0; row.len()];
        }
        n += 1.0;
        for (at, value) in row.iter().map(|value| f64::from(*value)).enumerate().take(squares.len()) {
            found[0][at] = found[0][at].min(value);
            found[1][at] = found[1][at].max(value);
            // Welford's running mean and variance.
            let difference = value - found[2][at];
            found[2][at] += difference / n;
            squares[at] += difference * (value - found[2][at]);
        }
    }
    found[3] = squares.into_iter().map(|square| (square / n.max(1.0)).sqrt()).collect();
    found
}

fn statistics<'a>(rows: impl Iterator<Item = &'a Vec<f32>> + Clone) -> Value {
    let [min, max, mean, std] = summary(rows.clone());
    json!({"min": min, "max": max, "mean": mean, "std": std, "count": [rows.count()]})
}

#[cfg(test)]
mod tests {
    use super::summary;

    #[test]
    fn mean_and_deviation_are_those_of_the_textbook() {
        let rows = [vec![1.0_f32, 2.0], vec![3.0, 2.0], vec![5.0, 2.0]];
        let [min, max, mean, std] = summary(&rows);
        assert_eq!((min, max, mean), (vec![1.0, 2.0], vec![5.0, 2.0], vec![3.0, 2.0]));
        assert!((std[0] - (8.0_f64 / 3.0).sqrt()).abs() < 1e-12 && std[1] == 0.0);
    }
}
