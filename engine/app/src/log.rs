//! `sfg log`: what is in a recording, and new files made from it.

mod data;
mod images;
#[cfg(feature = "parquet")]
mod lerobot;
#[cfg(feature = "parquet")]
mod table;

use crate::check::BadInput;
use crate::exit;
use crate::say::say;
use anyhow::Result;
use sfg_record::{Cut, LogFile, RecordError, recording_path};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// What to do with recordings.
#[derive(clap::Subcommand)]
pub(crate) enum LogCommand {
    /// Says what is in a recording: channels, rates, duration, metadata, and whether it is whole.
    Info {
        /// Folder of a run, or its run.mcap.
        run: PathBuf,
    },
    /// Makes a whole recording of one whose run was killed.
    Recover {
        /// Folder of a run, or its run.mcap.
        run: PathBuf,
        /// Where it goes; beside the old one when left out.
        #[arg(long, value_name = "FILE")]
        out: Option<PathBuf>,
    },
    /// Makes a recording of a part of another.
    Cut {
        /// Folder of a run, or its run.mcap.
        run: PathBuf,
        /// Begin, seconds of robot time.
        #[arg(long, value_name = "SECONDS", default_value_t = 0.0)]
        from: f64,
        /// End, seconds of robot time; that of the run when left out.
        #[arg(long, value_name = "SECONDS")]
        to: Option<f64>,
        /// Where it goes; beside the old one when left out.
        #[arg(long, value_name = "FILE")]
        out: Option<PathBuf>,
    },
    /// Says in which tick two runs begin to differ and which decisions are others.
    Diff {
        /// Folder of a run, or its run.mcap.
        a: PathBuf,
        /// The other.
        b: PathBuf,
    },
    /// Writes data and pictures for other programs.
    Export(ExportOptions),
}

/// What to export.
#[derive(clap::Args)]
pub(crate) struct ExportOptions {
    /// Folders of runs, or their run.mcap.
    #[arg(required = true, value_name = "RUN")]
    runs: Vec<PathBuf>,
    /// One row a grasp: object, palm pose, joints, synergy coordinates, type, label, seed.
    #[arg(long, value_name = "FILE")]
    parquet: Option<PathBuf>,
    /// States and actions as a LeRobotDataset v3.0, one episode a run.
    #[arg(long, value_name = "FOLDER")]
    lerobot: Option<PathBuf>,
    /// The camera images as PNG.
    #[arg(long, value_name = "FOLDER")]
    png: Option<PathBuf>,
    /// An animated picture of the camera images, of the first run.
    #[arg(long, value_name = "FILE")]
    gif: Option<PathBuf>,
}

/// Opens a recording for a command: what is wrong with it is the user's to mend.
fn open(run: &Path) -> Result<LogFile> {
    Ok(LogFile::open(&recording_path(run)).map_err(|error| BadInput(error.to_string()))?)
}

/// A recording that cannot be read is bad input, a file that cannot be written is not.
fn sorted(error: RecordError) -> anyhow::Error {
    match error {
        RecordError::Unreadable { .. } => BadInput(error.to_string()).into(),
        _ => error.into(),
    }
}

/// `run.mcap` with a word before its ending: `run.recovered.mcap`.
fn beside(path: &Path, word: &str) -> PathBuf {
    path.with_extension(format!("{word}.mcap"))
}

pub(crate) fn execute(command: &LogCommand) -> Result<ExitCode> {
    match command {
        LogCommand::Info { run } => info(&open(run)?),
        LogCommand::Recover { run, out } => return recover(run, out.as_deref()),
        LogCommand::Cut { run, from, to, out } => {
            let file = open(run)?;
            let end_secs = file.span_ns().map_or(0.0, |(_, last)| last as f64 / 1e9);
            let part = Cut { from_secs: *from, to_secs: to.unwrap_or(end_secs) };
            let target = out.clone().unwrap_or_else(|| beside(file.path(), "cut"));
            let n_messages = sfg_record::cut(&file, part, &target).map_err(sorted)?;
            say!("{}: {:.2} to {:.2} s, {n_messages} messages", target.display(), part.from_secs, part.to_secs.min(end_secs));
        }
        LogCommand::Diff { a, b } => return diff(&open(a)?, &open(b)?),
        LogCommand::Export(options) => export(options)?,
    }
    Ok(ExitCode::SUCCESS)
}

fn info(file: &LogFile) {
    let megabytes = file.n_bytes() as f64 / 1e6;
    let (first, last) = file.span_ns().unwrap_or_default();
    say!("{}: {megabytes:.2} MB, {:.2} s of robot time", file.path().display(), (last - first) as f64 / 1e9);
    if !file.is_whole {
        say!(
            "cut off: its run was killed, or only a part was copied; everything up to {:.2} s can be read, {} bytes cannot\n\
             make it whole with: sfg log recover {}",
            last as f64 / 1e9,
            file.n_lost_bytes,
            file.path().display()
        );
    }
    say!("\nmetadata");
    for (key, value) in &file.metadata {
        say!("  {key:18} {value}");
    }
    for (name, n_bytes) in &file.attachments {
        say!("  {:18} {name}, {n_bytes} bytes", "attachment");
    }
    say!("\n{:30} {:30} {:>8} {:>9} {:>9}", "channel", "schema", "messages", "per s", "kB");
    for channel in file.channels() {
        let secs = (channel.last_ns - channel.first_ns) as f64 / 1e9;
        let rate = if channel.n_messages > 1 && secs > 0.0 {
            format!("{:.1}", (channel.n_messages - 1) as f64 / secs)
        } else {
            "-".to_owned()
        };
        let kilobytes = channel.n_bytes as f64 / 1e3;
        say!("{:30} {:30} {:>8} {rate:>9} {kilobytes:>9.1}", channel.topic, channel.schema, channel.n_messages);
    }
}

fn recover(run: &Path, out: Option<&Path>) -> Result<ExitCode> {
    let file = open(run)?;
    if file.is_whole && out.is_none() {
        say!("{} is whole: there is nothing to recover", file.path().display());
        return Ok(ExitCode::SUCCESS);
    }
    let target = out.map_or_else(|| beside(file.path(), "recovered"), Path::to_owned);
    let recovered = sfg_record::recover(&file, &target).map_err(sorted)?;
    say!(
        "{}: {} messages up to {:.2} s; {} bytes at the end hold no whole message, at most the last second is missing",
        target.display(),
        recovered.n_messages,
        recovered.last_ns as f64 / 1e9,
        recovered.n_lost_bytes
    );
    Ok(ExitCode::SUCCESS)
}

fn diff(a: &LogFile, b: &LogFile) -> Result<ExitCode> {
    for key in ["scenario_sha256", "instruction", "seed", "engine_version", "binary_sha256"] {
        let value = |file: &LogFile| file.metadata.get(key).cloned().unwrap_or_else(|| "-".to_owned());
        if value(a) != value(b) {
            say!("{key}: {} | {}", value(a), value(b));
        }
    }
    let difference = sfg_record::diff::diff(a, b).map_err(sorted)?;
    if difference.is_none() {
        say!("no difference: the same status changes in the same ticks, and the same decisions");
        return Ok(ExitCode::SUCCESS);
    }
    if let Some(tick) = &difference.tick {
        say!("first difference in tick {} at {:.3} s", tick.tick, tick.now_secs);
        for (sign, changes) in [("a", &tick.a), ("b", &tick.b)] {
            if changes.is_empty() {
                say!("  {sign}  nothing");
            }
            changes.iter().for_each(|change| say!("  {sign}  {change}"));
        }
    }
    for decision in &difference.decisions {
        say!("{}: {} | {}", decision.what, decision.a, decision.b);
    }
    Ok(exit::DIFFERENT.into())
}

fn export(options: &ExportOptions) -> Result<()> {
    let asked = [&options.parquet, &options.lerobot, &options.png, &options.gif];
    if asked.into_iter().all(Option::is_none) {
        let message = "nothing is asked for: give --parquet FILE, --lerobot FOLDER, --png FOLDER or --gif FILE";
        return Err(BadInput(message.to_owned()).into());
    }
    let files: Vec<LogFile> = options.runs.iter().map(|run| open(run)).collect::<Result<_>>()?;
    #[cfg(not(feature = "parquet"))]
    if options.parquet.is_some() || options.lerobot.is_some() {
        let message =
            "this program was built without Parquet; build it with: cargo build --release -p sfg-app --features parquet";
        return Err(BadInput(message.to_owned()).into());
    }
    #[cfg(feature = "parquet")]
    if let Some(path) = &options.parquet {
        let mut grasps = Vec::new();
        for file in &files {
            grasps.extend(data::grasps(file).map_err(sorted)?);
        }
        table::write_grasps(path, &grasps)?;
        say!("{}: {} grasps", path.display(), grasps.len());
    }
    #[cfg(feature = "parquet")]
    if let Some(folder) = &options.lerobot {
        let episodes = files.iter().map(data::episode).collect::<Result<Vec<_>>>()?;
        lerobot::write_dataset(folder, &episodes)?;
        say!("{}: {} episodes", folder.display(), episodes.len());
    }
    if let Some(folder) = &options.png {
        let n_images = images::write_stills(&files, folder)?;
        say!("{}: {n_images} images", folder.display());
    }
    if let (Some(path), Some(file)) = (&options.gif, files.first()) {
        let n_frames = images::write_gif(file, path)?;
        say!("{}: {n_frames} pictures", path.display());
    }
    Ok(())
}
