//! The command as its users meet it: built, started in a folder of its own, judged by exit code, words and files.

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "tests fail by panicking and say what they pass over")]

mod bad_input;
mod language;
mod log;
mod recording;
mod replay;
mod robots;
mod runs;
mod scenario_tests;
mod sweeps;
mod trees;

use serde_json::Value;
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// No command of these tests takes nearly as long, even on a busy machine.
const PATIENCE: Duration = Duration::from_secs(600);

/// A command under way; its words go to files in its folder.
struct Started {
    child: Child,
    stdout: PathBuf,
    stderr: PathBuf,
}

/// A command that has ended.
#[derive(Debug)]
struct Ended {
    code: Option<i32>,
    stdout: String,
    stderr: String,
}

/// Runs `sfg` in `folder` to its end.
fn sfg(folder: &Path, args: &[&str]) -> Ended {
    start(folder, args, &[]).wait()
}

/// Starts `sfg` in `folder`, where it finds no assets and takes the repository's.
fn start(folder: &Path, args: &[&str], env: &[(&str, &str)]) -> Started {
    let name = tempfile::Builder::new().prefix("said-").tempfile_in(folder).unwrap().into_temp_path();
    let (stdout, stderr) = (name.with_extension("out"), name.with_extension("err"));
    let child = Command::new(env!("CARGO_BIN_EXE_sfg"))
        .args(args)
        .envs(env.iter().copied())
        .current_dir(folder)
        .stdin(Stdio::null())
        .stdout(File::create(&stdout).unwrap())
        .stderr(File::create(&stderr).unwrap())
        .spawn()
        .unwrap();
    Started { child, stdout, stderr }
}

impl Started {
    fn wait(mut self) -> Ended {
        let begun = Instant::now();
        let status = loop {
            if let Some(status) = self.child.try_wait().unwrap() {
                break status;
            }
            if begun.elapsed() > PATIENCE {
                self.child.kill().unwrap();
                panic!("not over after {PATIENCE:?}: {}", fs::read_to_string(&self.stdout).unwrap());
            }
            std::thread::sleep(Duration::from_millis(5));
        };
        let ended = Ended {
            code: status.code(),
            stdout: fs::read_to_string(&self.stdout).unwrap(),
            stderr: fs::read_to_string(&self.stderr).unwrap(),
        };
        assert!(!ended.stderr.contains("panicked at"), "{}", ended.stderr);
        ended
    }

    /// Waits until the command has said `words`.
    #[cfg(unix)]
    fn wait_for(&mut self, words: &str) {
        let begun = Instant::now();
        while !fs::read_to_string(&self.stdout).unwrap().contains(words) {
            let is_over = self.child.try_wait().unwrap().is_some();
            assert!(
                !is_over && begun.elapsed() < PATIENCE,
                "never said {words:?}: {}",
                fs::read_to_string(&self.stderr).unwrap()
            );
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    /// Waits until this many stages have ended; the time of the last on the robot's clock.
    #[cfg(unix)]
    fn wait_for_stages(&mut self, n_stages: usize) -> f64 {
        let begun = Instant::now();
        loop {
            let said = fs::read_to_string(&self.stdout).unwrap();
            let stamps: Vec<f64> = said
                .lines()
                .filter(|line| line.contains(" ok "))
                .filter_map(|line| line.split_whitespace().next()?.parse().ok())
                .collect();
            if stamps.len() >= n_stages {
                return stamps[n_stages - 1];
            }
            assert!(begun.elapsed() < PATIENCE, "never ended {n_stages} stages: {said}");
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    #[cfg(unix)]
    fn signal(&self, name: &str) {
        let status = Command::new("kill").args(["-s", name, &self.child.id().to_string()]).status().unwrap();
        assert!(status.success());
    }
}

impl Ended {
    /// The command ended with `code` and said all of `words` to its standard error.
    #[track_caller]
    fn refused(&self, code: i32, words: &[&str]) {
        assert_eq!(self.code, Some(code), "{self:#?}");
        assert!(self.stderr.starts_with("error: "), "{self:#?}");
        for word in words {
            assert!(self.stderr.contains(word), "{word:?} is not in:\n{}", self.stderr);
        }
    }

    #[track_caller]
    fn ended_with(self, code: i32) -> Self {
        assert_eq!(self.code, Some(code), "{self:#?}");
        self
    }
}

fn folder() -> tempfile::TempDir {
    tempfile::tempdir().unwrap()
}

/// A file of the repository.
fn repository(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(path).canonicalize().unwrap()
}

fn read_json(path: &Path) -> Value {
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// `value` without its keys `names`.
fn without(mut value: Value, names: &[&str]) -> Value {
    for name in names {
        assert!(value.as_object_mut().unwrap().remove(*name).is_some(), "there is no {name:?}");
    }
    value
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}
