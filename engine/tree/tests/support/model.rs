//! The tables of `control.rs` and `decorator.rs` a second time, as the plainest program that follows them. It shares the notation
//! of trees with the tests and nothing with the crate.
#![allow(dead_code, unreachable_pub, clippy::unwrap_used, reason = "shared by several test binaries; tests fail by panicking")]

use sfg_tree::{Literal, NodeKind, NodeSpec, PortValue};

/// What a node says.
#[derive(Clone, Debug, PartialEq)]
enum Said {
    Running,
    Success,
    /// With its reason.
    Failure(String),
    Skipped,
}
use Said::{Failure, Running, Skipped, Success};

/// What the tick has to offer.
pub struct World {
    pub tick_idx: usize,
    pub now_secs: f64,
    pub events: Vec<String>,
}

/// One node and what it remembers.
pub struct Model {
    kind: String,
    ports: Vec<(String, Literal)>,
    children: Vec<Model>,
    runs: bool,
    /// The child it stands at.
    at: usize,
    /// Rounds, attempts, or children that were not skipped.
    n: i64,
    /// What each child said, of a parallel.
    done: Vec<Option<Said>>,
    kept: Option<Said>,
    since_secs: f64,
    /// How often a leaf began, and the letter it is at.
    n_starts: usize,
    letter_idx: usize,
}

const KINDS: &[&str] = &[
    "scripted",
    "condition",
    "always_success",
    "always_failure",
    "sleep",
    "sequence",
    "async_sequence",
    "sequence_with_memory",
    "fallback",
    "async_fallback",
    "reactive_sequence",
    "reactive_fallback",
    "parallel",
    "parallel_all",
    "if_then_else",
    "while_do_else",
    "try_catch",
    "recover",
    "inverter",
    "force_success",
    "force_failure",
    "retry",
    "repeat",
    "keep_running_until_failure",
    "timeout",
    "delay",
    "rate_limit",
    "run_once",
];

impl Model {
    /// The model of a tree, or nothing when the tree has what the model has not: other nodes, panics, halts that take
    /// longer, and reactive nodes whose children are no leaves.
    pub fn of(spec: &NodeSpec) -> Option<Self> {
        let NodeKind::Named(kind) = &spec.kind else { return None };
        let literal = |value: &PortValue| match value {
            PortValue::Literal(literal) => Some(literal.clone()),
            PortValue::Key(_) => None,
        };
        let ports: Vec<(String, Literal)> =
            spec.ports.iter().map(|port| Some((port.name.clone(), literal(&port.value)?))).collect::<Option<_>>()?;
        let children: Vec<Self> = spec.children.iter().map(Self::of).collect::<Option<_>>()?;
        let model = Self {
            kind: kind.clone(),
            done: vec![None; children.len()],
            ports,
            children,
            runs: false,
            at: 0,
            n: 0,
            kept: None,
            since_secs: 0.0,
            n_starts: 0,
            letter_idx: 0,
        };
        let is_plain = !kind.starts_with("reactive") || model.children.iter().all(Self::is_leaf);
        let is_scripted = !model.is_leaf() || !model.text("script").contains(['X', '!']);
        (KINDS.contains(&kind.as_str()) && is_plain && is_scripted).then_some(model)
    }

    fn is_leaf(&self) -> bool {
        self.kind == "scripted" || self.kind == "condition"
    }

    fn port(&self, name: &str) -> Option<&Literal> {
        self.ports.iter().find(|(port, _)| port == name).map(|(_, literal)| literal)
    }

    fn text(&self, name: &str) -> String {
        match self.port(name) {
            Some(Literal::Text(text)) => text.clone(),
            _ => String::new(),
        }
    }

    fn number(&self, name: &str, default: f64) -> f64 {
        match self.port(name) {
            #[expect(clippy::cast_precision_loss, reason = "small")]
            Some(Literal::Int(number)) => *number as f64,
            Some(Literal::Float(number)) => *number,
            _ => default,
        }
    }

    #[expect(clippy::cast_possible_truncation, reason = "small")]
    fn whole(&self, name: &str, default: i64) -> i64 {
        self.port(name).map_or(default, |_| self.number(name, 0.0) as i64)
    }

    fn is_true(&self, name: &str, default: bool) -> bool {
        match self.port(name) {
            Some(Literal::Bool(truth)) => *truth,
            _ => default,
        }
    }

    /// Whether a list of reasons names this one.
    fn place_of(&self, reason: &str) -> Option<usize> {
        let Some(Literal::List(names)) = self.port("on") else { return None };
        names.iter().position(|name| matches!(name, Literal::Text(name) if name == reason || name == "any"))
    }

    /// One letter: the result of a tick of the tree.
    pub fn step(&mut self, world: &mut World) -> char {
        match self.tick(world) {
            Running => 'R',
            Success => 'S',
            Failure(_) => 'F',
            Skipped => 'K',
        }
    }

    fn tick(&mut self, world: &mut World) -> Said {
        let begins = !self.runs;
        if begins {
            self.since_secs = if self.kind == "rate_limit" { self.since_secs } else { world.now_secs };
            self.done.fill(None);
            if self.kind != "sequence_with_memory" {
                self.at = 0;
            }
            if !["run_once", "rate_limit", "sequence_with_memory"].contains(&self.kind.as_str()) {
                self.n = 0;
            }
        }
        self.runs = true;
        let said = self.work(begins, world);
        self.runs = said == Running;
        if !self.runs {
            self.halt_children(world);
        }
        said
    }

    /// Halts the node if it runs.
    pub fn halt(&mut self, world: &mut World) {
        if !self.runs {
            return;
        }
        self.runs = false;
        match self.kind.as_str() {
            "scripted" => world.events.push(format!("-{}", self.text("name_"))),
            "try_catch" => {
                let was_trying = self.at + 1 < self.children.len();
                self.halt_children(world);
                if was_trying && self.is_true("catch_on_halt", false) {
                    let last = self.children.len() - 1;
                    self.children[last].tick(world);
                    self.halt_children(world);
                }
            }
            _ => self.halt_children(world),
        }
    }

    fn halt_children(&mut self, world: &mut World) {
        for child in &mut self.children {
            child.halt(world);
        }
    }

    fn work(&mut self, begins: bool, world: &mut World) -> Said {
        match self.kind.clone().as_str() {
            "scripted" => self.scripted(begins, world),
            "condition" => {
                world.events.push(format!("?{}", self.text("name_")));
                let script = self.text("script");
                let holds = script.chars().nth((world.tick_idx - 1).min(script.len() - 1)) == Some('S');
                if holds { Success } else { Failure("condition_false".to_owned()) }
            }
            "always_success" => Success,
            "always_failure" => Failure("always_failure".to_owned()),
            "sleep" if world.now_secs < self.since_secs + self.number("secs", 0.0) => Running,
            "sleep" => Success,
            "sequence" => self.row(false, false, world),
            "async_sequence" => self.row(false, true, world),
            "fallback" => self.row(true, false, world),
            "async_fallback" => self.row(true, true, world),
            "sequence_with_memory" => {
                let said = self.row(false, true, world);
                if matches!(said, Success | Skipped) {
                    (self.at, self.n) = (0, 0);
                }
                said
            }
            "reactive_sequence" => self.reactive(false, world),
            "reactive_fallback" => self.reactive(true, world),
            "parallel" => self.parallel(world),
            "parallel_all" => self.parallel_all(world),
            "if_then_else" => {
                if self.at == 0 {
                    match self.children[0].tick(world) {
                        Success => self.at = 1,
                        Failure(_) if self.children.len() == 3 => self.at = 2,
                        said => return said,
                    }
                }
                let at = self.at;
                self.children[at].tick(world)
            }
            "while_do_else" => {
                let (taken, other) = match self.children[0].tick(world) {
                    Success => (1, 2),
                    Failure(_) if self.children.len() == 3 => (2, 1),
                    said => return said,
                };
                if let Some(other) = self.children.get_mut(other) {
                    other.halt(world);
                }
                self.children[taken].tick(world)
            }
            "try_catch" => self.try_catch(world),
            "recover" => self.recover(world),
            _ => self.decorator(begins, world),
        }
    }

    fn scripted(&mut self, begins: bool, world: &mut World) -> Said {
        let mark = if begins { '+' } else { '.' };
        world.events.push(format!("{mark}{}", self.text("name_")));
        (self.n_starts, self.letter_idx) = if begins { (self.n_starts + 1, 0) } else { (self.n_starts, self.letter_idx + 1) };
        let script = self.text("script");
        let activations: Vec<&str> = script.split('|').collect();
        let letters: Vec<char> = activations[(self.n_starts - 1).min(activations.len() - 1)].chars().collect();
        match letters[self.letter_idx.min(letters.len() - 1)] {
            'R' => Running,
            'S' => Success,
            'K' => Skipped,
            _ => Failure(self.text("reason")),
        }
    }

    fn row(&mut self, ends_on_success: bool, is_async: bool, world: &mut World) -> Said {
        while self.at < self.children.len() {
            let at = self.at;
            let was_done_in_one_call = !self.children[at].runs;
            let said = self.children[at].tick(world);
            match &said {
                Running => return Running,
                Success if ends_on_success => return Success,
                Failure(_) if !ends_on_success => return said,
                _ => {}
            }
            self.at += 1;
            if said == Skipped {
                continue;
            }
            self.n += 1;
            self.kept = Some(said);
            if is_async && was_done_in_one_call && self.at < self.children.len() {
                return Running;
            }
        }
        if self.n == 0 { Skipped } else { self.kept.clone().unwrap() }
    }

    /// Children are leaves. An action that starts while another child runs has that one halted first.
    fn reactive(&mut self, ends_on_success: bool, world: &mut World) -> Said {
        let mut last = Skipped;
        for child_idx in 0..self.children.len() {
            let starts = self.children[child_idx].kind == "scripted" && !self.children[child_idx].runs;
            if starts {
                self.halt_children(world);
            }
            let said = self.children[child_idx].tick(world);
            let ends = matches!((&said, ends_on_success), (Success, true) | (Failure(_), false));
            if said == Running {
                for other_idx in (0..self.children.len()).filter(|other_idx| *other_idx != child_idx) {
                    self.children[other_idx].halt(world);
                }
            }
            if said == Running || ends {
                return said;
            }
            if said != Skipped {
                last = said;
            }
        }
        last
    }

    fn counted(&self, number: i64) -> usize {
        let n_children = i64::try_from(self.children.len()).unwrap();
        usize::try_from(if number < 0 { (n_children + number + 1).max(0) } else { number }).unwrap()
    }

    fn count(&self, is_counted: fn(&Said) -> bool) -> usize {
        self.done.iter().flatten().filter(|said| is_counted(said)).count()
    }

    /// Ticks the unfinished children in order until `is_over` says so after one of them.
    fn tick_unfinished(&mut self, world: &mut World, is_over: impl Fn(&Self) -> Option<Said>) -> Option<Said> {
        for child_idx in 0..self.children.len() {
            // A skipped child is asked again on every tick.
            if !matches!(self.done[child_idx], Some(Success | Failure(_))) {
                let said = self.children[child_idx].tick(world);
                if matches!(said, Failure(_)) {
                    self.kept = Some(said.clone());
                }
                self.done[child_idx] = (said != Running).then_some(said);
            }
            if let Some(said) = is_over(self) {
                return Some(said);
            }
        }
        None
    }

    fn parallel(&mut self, world: &mut World) -> Said {
        let success = self.whole("success", -1);
        let (n_success, n_failure, n_all) = (self.counted(success), self.counted(self.whole("failure", 1)), self.children.len());
        if n_success > n_all || n_failure > n_all {
            return Failure("out_of_reach".to_owned());
        }
        for said in self.done.iter_mut().filter(|said| **said == Some(Skipped)) {
            *said = None;
        }
        let over = self.tick_unfinished(world, |node| {
            let (n_succeeded, n_failed) = (node.count(|said| *said == Success), node.count(|said| matches!(said, Failure(_))));
            let n_skipped = node.count(|said| *said == Skipped);
            if n_succeeded >= n_success || (success < 0 && n_succeeded + n_skipped >= n_success) {
                return Some(Success);
            }
            (n_failed >= n_failure || n_all - n_failed < n_success).then(|| node.kept.clone().unwrap())
        });
        over.unwrap_or(if self.count(|said| *said == Skipped) == n_all { Skipped } else { Running })
    }

    fn parallel_all(&mut self, world: &mut World) -> Said {
        let max_failures = self.counted(self.whole("max_failures", 1));
        if max_failures > self.children.len() {
            return Failure("out_of_reach".to_owned());
        }
        self.tick_unfinished(world, |_node| None);
        let n_skipped = self.count(|said| *said == Skipped);
        if n_skipped == self.children.len() {
            return Skipped;
        }
        if self.done.iter().any(Option::is_none) {
            return Running;
        }
        if self.count(|said| matches!(said, Failure(_))) >= max_failures { self.kept.clone().unwrap() } else { Success }
    }

    fn try_catch(&mut self, world: &mut World) -> Said {
        let last = self.children.len() - 1;
        while self.at < last {
            let at = self.at;
            match self.children[at].tick(world) {
                Running => return Running,
                failure @ Failure(_) => {
                    self.halt_children(world);
                    (self.at, self.kept) = (last, Some(failure));
                }
                said => {
                    self.n += i64::from(said == Success);
                    if at + 1 == last {
                        return if self.n == 0 { Skipped } else { Success };
                    }
                    self.at += 1;
                }
            }
        }
        if self.children[last].tick(world) == Running { Running } else { self.kept.clone().unwrap() }
    }

    fn recover(&mut self, world: &mut World) -> Said {
        loop {
            let at = self.at;
            let was_done_in_one_call = !self.children[at].runs;
            match (at, self.children[at].tick(world)) {
                (_, Running) => return Running,
                (0, Failure(reason)) => {
                    self.n += 1;
                    let branch = self.place_of(&reason).filter(|_| self.n < self.whole("attempts", 1));
                    let Some(branch) = branch else { return Failure(reason) };
                    (self.at, self.kept) = (branch + 1, Some(Failure(reason)));
                }
                (0, said) => return said,
                (_, Failure(_)) => return self.kept.clone().unwrap(),
                _ => {
                    self.at = 0;
                    if was_done_in_one_call {
                        return Running;
                    }
                }
            }
        }
    }

    fn decorator(&mut self, begins: bool, world: &mut World) -> Said {
        let since_secs = self.since_secs;
        match self.kind.as_str() {
            "inverter" => match self.children[0].tick(world) {
                Success => Failure("inverted".to_owned()),
                Failure(_) => Success,
                said => said,
            },
            "force_success" => match self.children[0].tick(world) {
                Failure(_) => Success,
                said => said,
            },
            "force_failure" => match self.children[0].tick(world) {
                Success => Failure("inverted".to_owned()),
                said => said,
            },
            "retry" | "repeat" => self.rounds(world),
            "keep_running_until_failure" => match self.children[0].tick(world) {
                failure @ Failure(_) => failure,
                _ => Running,
            },
            "timeout" if !begins && world.now_secs >= since_secs + self.number("secs", 0.0) => Failure("timeout".to_owned()),
            "delay" if world.now_secs < since_secs + self.number("secs", 0.0) => Running,
            "rate_limit" => {
                let is_early = self.n > 0 && world.now_secs < since_secs + 1.0 / self.number("hz", 1.0);
                if !self.children[0].runs {
                    if is_early {
                        return Running;
                    }
                    (self.n, self.since_secs) = (1, world.now_secs);
                }
                self.children[0].tick(world)
            }
            "run_once" => {
                if let Some(kept) = self.kept.clone() {
                    return if self.is_true("then_skip", true) { Skipped } else { kept };
                }
                let said = self.children[0].tick(world);
                if matches!(said, Success | Failure(_)) {
                    self.kept = Some(said.clone());
                }
                said
            }
            _ => self.children[0].tick(world),
        }
    }

    fn rounds(&mut self, world: &mut World) -> Said {
        let is_retry = self.kind == "retry";
        let limit = if is_retry { self.whole("attempts", -1) } else { self.whole("times", -1) };
        loop {
            let was_done_in_one_call = !self.children[0].runs;
            let said = self.children[0].tick(world);
            match &said {
                Failure(reason) if is_retry => {
                    let is_for_it = self.port("on").is_none() || self.place_of(reason).is_some();
                    self.n += 1;
                    if self.n == limit || !is_for_it {
                        return said;
                    }
                }
                Success if !is_retry => {
                    self.n += 1;
                    if self.n == limit {
                        return Success;
                    }
                }
                _ => return said,
            }
            if was_done_in_one_call {
                return Running;
            }
        }
    }
}

/// The trace of a tree by the model, in the notation of [`super::run`].
pub fn run(spec: &NodeSpec, steps: &str) -> Option<String> {
    let mut tree = Model::of(spec)?;
    let mut world = World { tick_idx: 0, now_secs: 0.0, events: Vec::new() };
    let mut trace = Vec::new();
    for step in steps.chars() {
        let result = if step == 't' {
            world.tick_idx += 1;
            let result = tree.step(&mut world);
            world.now_secs += 1.0;
            result
        } else {
            tree.halt(&mut world);
            'h'
        };
        world.events.push(result.to_string());
        trace.push(std::mem::take(&mut world.events).join(" "));
    }
    Some(trace.join(" ; "))
}
