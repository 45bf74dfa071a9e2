//! What a tree can be built with and still cannot mean: nodes that are never reached, times that never run out, keys and
//! subtrees that nobody uses.

use crate::mistake::{Mistake, Place};
use crate::reasons::{ReasonPlace, Reasons};
use sfg_tree::{
    Direction, Literal, NodeClass, NodeKind, NodeModel, NodeSpec, PortSpec, PortValue, SubtreeSpec, TreeSpec, When, nearest,
};
use std::collections::{BTreeMap, BTreeSet};

/// A tree whose subtrees do not contain themselves.
pub(crate) struct Reviewed<'a> {
    pub(crate) tree: &'a TreeSpec,
    pub(crate) models: &'a [NodeModel],
    /// Keys that the application sets.
    pub(crate) entry_keys: &'a [&'a str],
    pub(crate) places: &'a [Place],
    /// Where the keys of the blackboard's first entries stand.
    pub(crate) entry_places: &'a [Place],
    /// Where the reasons stand that nodes wait for.
    pub(crate) reason_places: &'a [ReasonPlace],
    /// Some node could not be read: it may use the subtrees and keys that nobody else does.
    pub(crate) has_unread_nodes: bool,
    /// Some node is of an unknown kind: it may use the keys that nobody else does.
    pub(crate) has_unknown_nodes: bool,
}

/// Every finding; `timeout_secs` is the time for the whole run, if that could be read.
pub(crate) fn review(reviewed: &Reviewed<'_>, timeout_secs: Option<f64>) -> Vec<Mistake> {
    let mut mistakes = Vec::new();
    let subtrees: BTreeMap<&str, &SubtreeSpec> =
        reviewed.tree.subtrees.iter().map(|subtree| (subtree.name.as_str(), subtree)).collect();
    Reach { reviewed, subtrees: &subtrees, known: BTreeMap::new(), mistakes: &mut mistakes }.check();
    Times { reviewed, uses: BTreeMap::new(), limits: BTreeMap::new(), timeout_secs, mistakes: &mut mistakes }.check();
    Reasons::new(reviewed, &subtrees).check(&mut mistakes);
    Names::default().check(reviewed, &subtrees, &mut mistakes);
    mistakes
}

impl<'a> Reviewed<'a> {
    pub(crate) fn place(&self, location: u32) -> Place {
        self.places.get(location as usize).copied().unwrap_or(Place::START)
    }

    pub(crate) fn model(&self, node: &NodeSpec) -> Option<&'a NodeModel> {
        let NodeKind::Named(name) = &node.kind else { return None };
        self.models.iter().find(|model| model.name == *name)
    }

    /// The roots of the tree and of every subtree, with the subtree's name.
    pub(crate) fn roots(&self) -> impl Iterator<Item = (Option<&'a str>, &'a NodeSpec)> + use<'a> {
        let tree = self.tree;
        let subtrees = tree.subtrees.iter().map(|subtree| (Some(subtree.name.as_str()), &subtree.root));
        std::iter::once((None, &tree.root)).chain(subtrees)
    }
}

/// The kind of a node, or the name of its subtree.
fn kind(node: &NodeSpec) -> &str {
    match &node.kind {
        NodeKind::Named(name) | NodeKind::Subtree(name) => name,
    }
}

/// A number that a port is given in the file.
fn number(node: &NodeSpec, port: &str) -> Option<(f64, u32)> {
    let setting = node.ports.iter().find(|setting| setting.name == port)?;
    #[expect(clippy::cast_precision_loss, reason = "counts and seconds are far below 2^53")]
    match &setting.value {
        PortValue::Literal(Literal::Int(value)) => Some((*value as f64, setting.location)),
        PortValue::Literal(Literal::Float(value)) => Some((*value, setting.location)),
        _ => None,
    }
}

/// How a node can end. One that can end in no way runs for ever.
#[derive(Clone, Copy)]
struct Ends {
    success: bool,
    failure: bool,
    skipped: bool,
}

impl Ends {
    /// A leaf; few have nothing to do, and those that have say so nowhere.
    const ANY: Self = Self { success: true, failure: true, skipped: false };
    const NEVER: Self = Self { success: false, failure: false, skipped: false };

    fn or(self, other: Self) -> Self {
        Self {
            success: self.success || other.success,
            failure: self.failure || other.failure,
            skipped: self.skipped || other.skipped,
        }
    }
}

/// Nodes that are never reached, and nodes that change nothing.
struct Reach<'a, 'm> {
    reviewed: &'m Reviewed<'a>,
    subtrees: &'m BTreeMap<&'a str, &'a SubtreeSpec>,
    known: BTreeMap<&'a str, Ends>,
    mistakes: &'m mut Vec<Mistake>,
}

impl<'a> Reach<'a, '_> {
    fn check(&mut self) {
        for (name, root) in self.reviewed.roots() {
            match name {
                None => drop(self.ends(root)),
                Some(name) => drop(self.subtree(name)),
            }
        }
    }

    fn subtree(&mut self, name: &'a str) -> Ends {
        if let Some(known) = self.known.get(name) {
            return *known;
        }
        let ends = self.subtrees.get(name).map_or(Ends::ANY, |subtree| self.ends(&subtree.root));
        self.known.insert(name, ends);
        ends
    }

    fn ends(&mut self, node: &'a NodeSpec) -> Ends {
        let children: Vec<Ends> = node.children.iter().map(|child| self.ends(child)).collect();
        let mut ends = match &node.kind {
            NodeKind::Subtree(name) => self.subtree(name),
            NodeKind::Named(name) => self.named(name, node, &children),
        };
        for condition in &node.conditions {
            match condition.when {
                When::FailureIf => ends.failure = true,
                When::SuccessIf => ends.success = true,
                When::SkipIf | When::While => ends.skipped = true,
                _ => {}
            }
        }
        ends
    }

    fn named(&mut self, name: &str, node: &'a NodeSpec, children: &[Ends]) -> Ends {
        let child = children.first().copied().unwrap_or(Ends::ANY);
        match name {
            "always_success" => Ends { success: true, ..Ends::NEVER },
            "always_failure" => Ends { failure: true, ..Ends::NEVER },
            "force_success" => Ends { success: child.success || child.failure, failure: false, ..child },
            "force_failure" => Ends { failure: child.success || child.failure, success: false, ..child },
            "inverter" => Ends { success: child.failure, failure: child.success, ..child },
            "sequence" | "async_sequence" | "sequence_with_memory" | "reactive_sequence" => {
                self.row(node, children, "succeed", |ends| ends.success)
            }
            "fallback" | "async_fallback" | "reactive_fallback" => self.row(node, children, "fail", |ends| ends.failure),
            "if_then_else" | "while_do_else" => self.branches(node, children),
            "retry" => {
                self.check_useful(node, child.failure, "never fails");
                Ends { failure: child.failure && number(node, "attempts").is_none_or(|(n, _)| n >= 0.0), ..child }
            }
            "repeat" => {
                let times = number(node, "times").map(|(times, _)| times);
                self.check_useful(node, times != Some(1.0), "is done once without it");
                let is_given = node.ports.iter().any(|setting| setting.name == "times");
                Ends { success: child.success && is_given && times != Some(-1.0), ..child }
            }
            "timeout" => {
                let of = node.children.first();
                let is_slow = of.is_none_or(|child| !self.is_done_at_once(child));
                self.check_useful(node, is_slow, "is done within a tick");
                Ends { failure: true, ..child }
            }
            "delay" | "run_once" | "rate_limit" => child,
            "keep_running_until_failure" => Ends { success: false, ..child },
            _ => Ends::ANY,
        }
    }

    /// Children one after the other, as long as `goes_on` is how they end.
    fn row(&mut self, node: &'a NodeSpec, children: &[Ends], word: &str, goes_on: impl Fn(&Ends) -> bool) -> Ends {
        let is_wall = |ends: &Ends| !goes_on(ends) && !ends.skipped;
        if let Some(wall) = children.iter().position(is_wall)
            && let Some(child) = node.children.get(wall + 1)
        {
            let message =
                format!("{:?} is never reached: {:?} before it can never {word}", kind(child), kind(&node.children[wall]));
            self.report(child, message, "remove it, or put it first");
        }
        let reached = children.iter().position(is_wall).map_or(children, |wall| &children[..=wall]);
        let any = reached.iter().fold(Ends::NEVER, |all, ends| all.or(*ends));
        let all_go_on = reached.iter().all(|ends| goes_on(ends) || ends.skipped) && reached.iter().any(&goes_on);
        let skipped = reached.iter().all(|ends| ends.skipped);
        if word == "succeed" {
            Ends { success: all_go_on, failure: any.failure, skipped }
        } else {
            Ends { success: any.success, failure: all_go_on, skipped }
        }
    }

    fn branches(&mut self, node: &'a NodeSpec, children: &[Ends]) -> Ends {
        let [condition, branches @ ..] = children else { return Ends::ANY };
        for (branch, (is_reached, word)) in
            node.children[1..].iter().zip([(condition.success, "succeed"), (condition.failure, "fail")])
        {
            if !is_reached {
                let message = format!("{:?} is never reached: {:?} can never {word}", kind(branch), kind(&node.children[0]));
                self.report(branch, message, "remove it, or ask another condition");
            }
        }
        let all = branches.iter().fold(Ends::NEVER, |all, ends| all.or(*ends));
        // Without an `else` a false condition fails.
        if branches.len() < 2 { Ends { failure: true, ..all } } else { all }
    }

    fn is_done_at_once(&self, node: &NodeSpec) -> bool {
        match self.reviewed.model(node).map(|model| model.class) {
            Some(NodeClass::Step | NodeClass::Condition) => kind(node) != "sleep",
            _ => false,
        }
    }

    fn check_useful(&mut self, node: &NodeSpec, is_useful: bool, why_not: &str) {
        if let (false, Some(child)) = (is_useful, node.children.first()) {
            let message = format!("{:?} changes nothing: {:?} {why_not}", kind(node), kind(child));
            self.mistakes.push(Mistake::warning(self.reviewed.place(node.location), message).help("remove it"));
        }
    }

    fn report(&mut self, node: &NodeSpec, message: String, help: &str) {
        self.mistakes.push(Mistake::new(self.reviewed.place(node.location), message).help(help));
    }
}

/// A time within which something has to be done.
#[derive(Clone, Copy)]
struct Limit {
    secs: f64,
    /// Where it is given; nothing for the whole run.
    place: Option<Place>,
}

/// Where a subtree is used.
#[derive(Clone, Copy)]
struct Use<'a> {
    /// The subtree around, if it is not the tree itself.
    around: Option<&'a str>,
    /// The shortest time around it there.
    limit: Option<Limit>,
}

/// Times that can never run out, because a shorter one around them does first.
struct Times<'a, 'm> {
    reviewed: &'m Reviewed<'a>,
    uses: BTreeMap<&'a str, Vec<Use<'a>>>,
    /// The longest time that any user of a subtree leaves it.
    limits: BTreeMap<Option<&'a str>, Option<Limit>>,
    timeout_secs: Option<f64>,
    mistakes: &'m mut Vec<Mistake>,
}

impl<'a> Times<'a, '_> {
    fn check(&mut self) {
        let roots: Vec<_> = self.reviewed.roots().collect();
        for (name, root) in &roots {
            self.collect(*name, root, None);
        }
        for (name, root) in roots {
            let limit = self.limit_of(name);
            self.compare(root, limit);
        }
    }

    fn collect(&mut self, around: Option<&'a str>, node: &'a NodeSpec, limit: Option<Limit>) {
        if let NodeKind::Subtree(name) = &node.kind {
            self.uses.entry(name).or_default().push(Use { around, limit });
        }
        let inner = self.within(node, limit);
        node.children.iter().for_each(|child| self.collect(around, child, inner));
    }

    /// The shorter of the time around a node and its own, if it is a `timeout`.
    fn within(&self, node: &NodeSpec, limit: Option<Limit>) -> Option<Limit> {
        let own = (kind(node) == "timeout").then(|| number(node, "secs")).flatten();
        let own = own.map(|(secs, location)| Limit { secs, place: Some(self.reviewed.place(location)) });
        shorter(limit, own)
    }

    fn limit_of(&mut self, name: Option<&'a str>) -> Option<Limit> {
        if let Some(known) = self.limits.get(&name) {
            return *known;
        }
        let whole = self.timeout_secs.map(|secs| Limit { secs, place: None });
        let limit = match name.and_then(|name| self.uses.get(name)).cloned() {
            None => whole,
            Some(uses) => {
                let limits: Vec<_> = uses.into_iter().map(|one| shorter(self.limit_of(one.around), one.limit)).collect();
                let longest = limits.into_iter().max_by(|a, b| secs_of(*a).total_cmp(&secs_of(*b)));
                longest.flatten()
            }
        };
        self.limits.insert(name, limit);
        limit
    }

    fn compare(&mut self, node: &NodeSpec, limit: Option<Limit>) {
        let waits = ["timeout", "sleep", "delay"].contains(&kind(node));
        if let (true, Some((secs, location)), Some(limit)) = (waits, number(node, "secs"), limit)
            && secs > limit.secs
        {
            let never = if kind(node) == "timeout" { "can never run out" } else { "can never end" };
            let around = match limit.place {
                None => format!("the whole run ends after {} s", limit.secs),
                Some(place) => format!("the timeout around it, in line {}, ends after {} s", place.line, limit.secs),
            };
            let message = format!("{:?} of {secs} s {never}: {around}", kind(node));
            let help = match limit.place {
                None => "give `limits: {timeout_secs: ...}` more, or this less",
                Some(_) => "give the timeout around it more, or this less",
            };
            self.mistakes.push(Mistake::new(self.reviewed.place(location), message).help(help));
        }
        let inner = self.within(node, limit);
        node.children.iter().for_each(|child| self.compare(child, inner));
    }
}

fn secs_of(limit: Option<Limit>) -> f64 {
    limit.map_or(f64::INFINITY, |limit| limit.secs)
}

fn shorter(a: Option<Limit>, b: Option<Limit>) -> Option<Limit> {
    if secs_of(b) < secs_of(a) { b } else { a }
}

/// Subtrees that nobody uses, and keys that only one side knows. Keys are told apart by name alone, so that a key of one
/// subtree may hide that of another: better a finding too few than one too many.
#[derive(Default)]
struct Names<'a> {
    used_subtrees: BTreeSet<&'a str>,
    /// Keys that a node is told to write, with the place.
    written: Vec<(&'a str, u32)>,
    /// Keys that a node is told to read and may find empty.
    read: Vec<(&'a str, u32)>,
    all_written: BTreeSet<&'a str>,
    all_read: BTreeSet<&'a str>,
    /// What scripts speak of, which may be read or written.
    in_scripts: BTreeSet<&'a str>,
    /// A subtree in it shares all keys.
    is_open: bool,
}

impl<'a> Names<'a> {
    fn check(mut self, reviewed: &Reviewed<'a>, subtrees: &BTreeMap<&'a str, &'a SubtreeSpec>, mistakes: &mut Vec<Mistake>) {
        for (_, root) in reviewed.roots() {
            self.node(reviewed, subtrees, root);
        }
        let is_own = |place: Place| place.file == 0;
        let mut warn = |place: Place, message: String, help: String| {
            // A file that others include holds more than each of them needs.
            if is_own(place) {
                mistakes.push(Mistake::warning(place, message).help(help));
            }
        };
        let near = |key: &str, keys: &BTreeSet<&str>| match nearest(key, keys.iter().copied()) {
            Some(near) => format!("did you mean {near:?}?"),
            None => "remove it".to_owned(),
        };
        for subtree in &reviewed.tree.subtrees {
            if !reviewed.has_unread_nodes && !self.used_subtrees.contains(subtree.name.as_str()) {
                let help = format!("write `subtree: {}` where it is meant, or remove it", subtree.name);
                warn(reviewed.place(subtree.location), format!("subtree {:?} is not used", subtree.name), help);
            }
        }
        if reviewed.has_unread_nodes || reviewed.has_unknown_nodes {
            return;
        }
        for subtree in &reviewed.tree.subtrees {
            let mut inside = Names::default();
            inside.node(reviewed, subtrees, &subtree.root);
            for port in &subtree.ports {
                // What a port brings in is there to be read, what it takes out is read by somebody.
                self.all_written.extend(port.direction.reads().then_some(port.name.as_str()));
                self.all_read.extend(port.direction.writes().then_some(port.name.as_str()));
                let name = port.name.as_str();
                let is_read = inside.all_read.contains(name) || inside.in_scripts.contains(name);
                let is_written = inside.all_written.contains(name) || inside.in_scripts.contains(name);
                let (is_used, verb, keys) = match port.direction {
                    Direction::In => (is_read, "reads", &inside.all_read),
                    Direction::Out => (is_written, "writes", &inside.all_written),
                    Direction::InOut => (is_read || is_written, "uses", &inside.all_written),
                };
                if !is_used && !inside.is_open {
                    let message = format!("nothing in subtree {:?} {verb} its port {name:?}", subtree.name);
                    warn(reviewed.place(port.location), message, near(name, keys));
                }
            }
        }
        for ((key, _, _), place) in reviewed.tree.entries.iter().zip(reviewed.entry_places) {
            if !self.all_read.contains(key.as_str()) && !self.in_scripts.contains(key.as_str()) {
                let message = format!("nobody reads blackboard key {key:?}");
                warn(*place, message, near(key, &self.all_read));
            }
        }
        for (key, location) in &self.written {
            if !self.all_read.contains(key) && !self.in_scripts.contains(key) {
                warn(reviewed.place(*location), format!("nobody reads blackboard key {key:?}"), near(key, &self.all_read));
            }
        }
        self.all_written.extend(reviewed.entry_keys);
        self.all_written.extend(reviewed.tree.entries.iter().map(|(key, _, _)| key.as_str()));
        for (key, location) in &self.read {
            if !self.all_written.contains(key) && !self.in_scripts.contains(key) {
                warn(reviewed.place(*location), format!("nobody writes blackboard key {key:?}"), near(key, &self.all_written));
            }
        }
    }

    fn node(&mut self, reviewed: &Reviewed<'a>, subtrees: &BTreeMap<&'a str, &'a SubtreeSpec>, node: &'a NodeSpec) {
        node.conditions.iter().for_each(|condition| self.script(&condition.script));
        match &node.kind {
            NodeKind::Subtree(name) => {
                self.used_subtrees.insert(name);
                self.is_open |= node.is_autoremapped;
                if let Some(subtree) = subtrees.get(name.as_str()) {
                    let ports = subtree.ports.iter().map(|port| (port.name.as_str(), Some(port.name.as_str()), port.direction));
                    self.ports(node, ports.collect());
                    if subtree.is_open {
                        // Whatever it is given has that name inside, too.
                        node.ports.iter().for_each(|setting| self.take(Some(&setting.name), Direction::InOut));
                    }
                }
            }
            NodeKind::Named(name) => {
                let ports = reviewed.model(node).map_or(&[][..], |model| &model.ports);
                // Ports that a file cannot give a value are connected to the key of their name.
                let default = |port: &'a PortSpec| port.port_type().shape().is_none().then(|| port.name());
                self.ports(node, ports.iter().map(|port| (port.name(), default(port), port.direction())).collect());
                for setting in &node.ports {
                    if let PortValue::Literal(Literal::Text(text)) = &setting.value
                        && ["script", "script_condition", "precondition", "switch"].contains(&name.as_str())
                    {
                        self.script(text);
                    }
                }
            }
        }
        node.children.iter().for_each(|child| self.node(reviewed, subtrees, child));
    }

    /// Takes the keys of a node's ports: name, key when nothing is given, direction.
    fn ports(&mut self, node: &'a NodeSpec, ports: Vec<(&'a str, Option<&'a str>, Direction)>) {
        for (name, default, direction) in &ports {
            let is_given = node.ports.iter().any(|setting| setting.name == *name);
            self.take(default.filter(|_| !is_given), *direction);
        }
        for setting in &node.ports {
            let PortValue::Key(key) = &setting.value else { continue };
            let key = key.trim_start_matches('@').split('.').next().unwrap_or(key);
            match ports.iter().find(|(name, _, _)| *name == setting.name) {
                Some((_, _, direction)) => {
                    self.take(Some(key), *direction);
                    let list = if direction.writes() { &mut self.written } else { &mut self.read };
                    list.push((key, setting.location));
                }
                // Whoever knows the port knows what it does.
                None => self.take(Some(key), Direction::InOut),
            }
        }
    }

    fn take(&mut self, key: Option<&'a str>, direction: Direction) {
        self.all_read.extend(key.filter(|_| direction.reads()));
        self.all_written.extend(key.filter(|_| direction.writes()));
    }

    fn script(&mut self, script: &'a str) {
        self.in_scripts.extend(script.split(|letter: char| !letter.is_ascii_alphanumeric() && letter != '_'));
    }
}
