//! Runs a small tree for some seconds where Groot2 can watch it, and writes a log that Groot2 plays back.
//!
//! ```text
//! cargo run -p sfg-tree --example groot2 -- --secs 60 run.btlog
//! ```
#![allow(clippy::print_stdout, reason = "a program for people")]

use sfg_tree::groot::{BtlogWriter, Server};
use sfg_tree::{
    Action, Direction, Failure, JournalLevel, NodeSpec, Outcome, PortSpec, Progress, Registry, SubtreePort, SubtreeSpec, Tick,
    TreeSpec, When,
};
use std::error::Error;
use std::fs::File;
use std::io::BufWriter;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// Moves for a second.
#[derive(Default)]
struct Approach {
    until_secs: f64,
}

impl Action<u32> for Approach {
    fn start(&mut self, tick: &mut Tick<'_, u32>) -> Outcome {
        self.until_secs = tick.now_secs() + 1.0;
        Ok(Progress::Running)
    }
    fn poll(&mut self, tick: &mut Tick<'_, u32>) -> Outcome {
        tick.set("distance_m", (self.until_secs - tick.now_secs()).max(0.0) / 10.0);
        Ok(if tick.now_secs() < self.until_secs { Progress::Running } else { Progress::Success })
    }
}

fn registry() -> Registry<u32> {
    let mut registry = Registry::new();
    registry.action("approach", [PortSpec::output::<f64>("distance_m")], Approach::default).doc("Moves to the object.");
    registry
        .step("close_hand", [PortSpec::output::<u32>("tries")], |tick| {
            *tick.context += 1;
            let tries = *tick.context;
            tick.set("tries", tries);
            if tries.is_multiple_of(3) { Ok(()) } else { Err(Failure::new("slipped", "every third try holds")) }
        })
        .doc("Closes the hand; holds at every third try.");
    registry
}

fn spec() -> TreeSpec {
    let port = SubtreePort { name: "tries".to_owned(), direction: Direction::Out, default: None, location: 0 };
    let grasp = SubtreeSpec {
        name: "grasp".to_owned(),
        ports: vec![port],
        root: NodeSpec::new("sequence").child(NodeSpec::new("approach")).child(NodeSpec::new("close_hand")),
        ..SubtreeSpec::default()
    };
    let again = NodeSpec::new("retry").with("attempts", 5).child(NodeSpec::subtree("grasp"));
    let round = NodeSpec::new("sequence")
        .child(NodeSpec::new("set_blackboard").with("value", vec!["cup", "jug"]).with_key("output_key", "parts"))
        .child(again)
        .child(NodeSpec::new("sleep").with("secs", 0.5).when(When::SkipIf, "tries > 5"))
        .child(NodeSpec::new("fallback").child(NodeSpec::new("always_failure")).child(NodeSpec::new("always_success")));
    TreeSpec::new(NodeSpec::new("repeat").child(round)).subtree(grasp)
}

struct Settings {
    port: u16,
    secs: f64,
    log: Option<String>,
}

fn settings() -> Result<Settings, Box<dyn Error>> {
    let mut settings = Settings { port: Server::PORT, secs: 10.0, log: None };
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        let mut value = || words.next().ok_or(format!("{word} needs a value"));
        match word.as_str() {
            "--port" => settings.port = value()?.parse()?,
            "--secs" => settings.secs = value()?.parse()?,
            _ if word.starts_with('-') => return Err(format!("unknown option {word}").into()),
            _ => settings.log = Some(word),
        }
    }
    Ok(settings)
}

fn main() -> Result<(), Box<dyn Error>> {
    let settings = settings()?;
    let mut tree = registry().build(&spec()).map_err(|errors| errors[0].to_string())?;
    tree.set_journal_level(JournalLevel::Transitions);
    let start_us = i64::try_from(SystemTime::now().duration_since(UNIX_EPOCH)?.as_micros())?;
    let mut log = match &settings.log {
        Some(path) => Some(BtlogWriter::for_tree(BufWriter::new(File::create(path)?), &tree, start_us)?),
        None => None,
    };
    let server = Server::start(settings.port, &tree)?;
    println!("{} nodes at tcp://127.0.0.1:{} for {} s", tree.n_nodes(), server.port(), settings.secs);
    let (begun, mut context, mut n_records) = (Instant::now(), 0, 0);
    while begun.elapsed().as_secs_f64() < settings.secs {
        tree.tick(begun.elapsed().as_secs_f64(), &mut context);
        let records = tree.drain_journal();
        server.update(&tree, &records);
        if let Some(log) = &mut log {
            log.records(&records)?;
        }
        n_records += records.len();
        let _woken = tree.waker().wait(Duration::from_millis(50));
    }
    if let (Some(log), Some(path)) = (log, &settings.log) {
        log.finish()?;
        println!("{path}: {n_records} records seen");
    }
    Ok(())
}
