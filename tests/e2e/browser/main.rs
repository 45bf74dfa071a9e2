//! The page in a browser: what it shows is what was recorded, and the console stays empty.
//!
//! Needs Chromium; where there is none the tests say so and pass. Screenshots go to `target/page`.

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "tests fail by panicking and say what they pass over")]

mod chromium;
mod page;
mod recorded;

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// No command of these tests takes nearly as long, even on a busy machine.
const PATIENCE: Duration = Duration::from_secs(600);

/// A command that serves the page, stopped when it is dropped.
struct Serving {
    child: Child,
    said: PathBuf,
    url: String,
}

impl Serving {
    /// Starts `sfg` and waits until it says where the page is.
    fn start(folder: &Path, args: &[&str]) -> Self {
        let name = tempfile::Builder::new().prefix("serves-").tempfile_in(folder).unwrap().into_temp_path();
        let said = name.with_extension("out");
        let file = File::create(&said).unwrap();
        let mut child = Command::new(env!("CARGO_BIN_EXE_sfg"))
            .args(args)
            .current_dir(folder)
            .stdin(Stdio::null())
            .stdout(file.try_clone().unwrap())
            .stderr(file)
            .spawn()
            .unwrap();
        let begun = Instant::now();
        let url = loop {
            let text = fs::read_to_string(&said).unwrap();
            if let Some(url) = text.split_whitespace().find(|word| word.starts_with("http://127.0.0.1:")) {
                break url.to_owned();
            }
            if begun.elapsed() > PATIENCE || child.try_wait().unwrap().is_some() {
                drop(child.kill());
                panic!("sfg {args:?} serves no page: {text}");
            }
            std::thread::sleep(Duration::from_millis(20));
        };
        Self { child, said, url }
    }

    /// The exit code of a command that ended on its own; `None` while it serves.
    fn ended(&mut self) -> Option<i32> {
        self.child.try_wait().unwrap().and_then(|status| status.code())
    }

    /// Waits for the command's own end.
    fn wait(&mut self) -> Option<i32> {
        let begun = Instant::now();
        while self.child.try_wait().unwrap().is_none() {
            assert!(begun.elapsed() < PATIENCE, "it does not end: {}", fs::read_to_string(&self.said).unwrap());
            std::thread::sleep(Duration::from_millis(20));
        }
        self.ended()
    }
}

impl Drop for Serving {
    fn drop(&mut self) {
        drop(self.child.kill());
        drop(self.child.wait());
        let said = fs::read_to_string(&self.said).unwrap_or_default();
        if !std::thread::panicking() {
            assert!(!said.contains("panicked at"), "{said}");
        }
    }
}

/// Runs `sfg` to its end and gives its exit code.
fn sfg(folder: &Path, args: &[&str]) -> i32 {
    let output = Command::new(env!("CARGO_BIN_EXE_sfg")).args(args).current_dir(folder).stdin(Stdio::null()).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(!said.contains("panicked at"), "{said}");
    output.status.code().unwrap()
}

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").canonicalize().unwrap()
}

/// Where screenshots go.
fn shots() -> PathBuf {
    Path::new(env!("CARGO_BIN_EXE_sfg")).parent().and_then(Path::parent).unwrap().join("page")
}

/// Numbers from a seed, the same everywhere (SplitMix64).
struct Random(u64);

impl Random {
    /// In [0, 1).
    fn share(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }
}
