//! How each node of the tree went, nested as in the tree.

use super::text::{escape, secs};
use sfg_tree::{NamedChange, NamedRecord, NodeDefinition, Status};
use std::collections::BTreeMap;
use std::fmt::Write as _;

/// A node that fails without end is told about so often.
const MAX_FAILURES: usize = 5;

/// A node over the whole run.
#[derive(Clone, Debug, Default)]
struct Node {
    parent: Option<usize>,
    title: String,
    kind: String,
    /// The last status before the node was made idle; `None` when it never began.
    status: Option<Status>,
    /// It was running when it was made idle.
    is_halted: bool,
    n_starts: usize,
    first_secs: f64,
    running_since_secs: Option<f64>,
    running_secs: f64,
    failures: Vec<(f64, String, String)>,
    n_failures: usize,
}

/// How a tree went, gathered from its journal while it runs: status, time and failures of each node.
#[derive(Clone, Debug, Default)]
pub struct TreeOutcome {
    nodes: Vec<Node>,
    by_path: BTreeMap<String, usize>,
}

impl TreeOutcome {
    /// The nodes of a tree with their paths, in document order; nothing has happened yet.
    #[must_use]
    pub fn new(definition: impl IntoIterator<Item = (String, NodeDefinition)>) -> Self {
        let mut outcome = Self::default();
        outcome.extend(definition);
        outcome
    }

    /// Takes up the nodes that a reload brought; what is known of others stays.
    pub fn extend(&mut self, definition: impl IntoIterator<Item = (String, NodeDefinition)>) {
        for (path, node) in definition {
            let parent = path.rsplit_once('/').and_then(|(parent, _)| self.by_path.get(parent).copied());
            let known = self.by_path.get(&path).copied();
            let idx = known.unwrap_or_else(|| {
                self.nodes.push(Node::default());
                self.nodes.len() - 1
            });
            self.by_path.insert(path, idx);
            self.nodes[idx].parent = parent;
            self.nodes[idx].title = node.title;
            self.nodes[idx].kind = node.kind;
        }
    }

    /// Takes up what happened since the last call.
    pub fn add(&mut self, records: &[NamedRecord]) {
        for record in records {
            let Some(&idx) = self.by_path.get(&record.path) else { continue };
            self.nodes[idx].take(record);
        }
    }

    pub(super) fn render(&self, page: &mut String) {
        if self.nodes.is_empty() {
            return;
        }
        page.push_str("<section><h2>How the tree went</h2><ul class=\"tree\">");
        let mut children = vec![Vec::new(); self.nodes.len()];
        for (idx, node) in self.nodes.iter().enumerate() {
            if let Some(parent) = node.parent {
                children[parent].push(idx);
            }
        }
        for root in (0..self.nodes.len()).filter(|idx| self.nodes[*idx].parent.is_none()) {
            self.render_node(page, root, &children);
        }
        page.push_str("</ul></section>");
    }

    fn render_node(&self, page: &mut String, idx: usize, children: &[Vec<usize>]) {
        let node = &self.nodes[idx];
        let (class, glyph, word) = node.shown();
        let _ = write!(
            page,
            "<li class=\"{class}\"><div class=\"node\"><span class=\"glyph\" title=\"{word}\">{glyph}</span><b>{}</b>",
            escape(&node.title)
        );
        if node.kind != node.title {
            let _ = write!(page, " <span class=\"soft\">{}</span>", escape(&node.kind));
        }
        let _ = write!(page, "<span class=\"when\">{word}");
        if node.n_starts > 1 {
            let _ = write!(page, ", {} times", node.n_starts);
        }
        if node.n_starts > 0 {
            let _ = write!(page, " · from {:.2} s", node.first_secs);
        }
        if node.running_secs > 0.0 {
            let _ = write!(page, " · ran {}", secs(node.running_secs));
        }
        page.push_str("</span></div>");
        for (at, reason, detail) in &node.failures {
            let _ = write!(page, "<p class=\"failure\">{} at {at:.2} s: {}</p>", escape(reason), escape(detail));
        }
        if node.n_failures > node.failures.len() {
            let _ = write!(page, "<p class=\"failure\">and {} more failures</p>", node.n_failures - node.failures.len());
        }
        if !children[idx].is_empty() {
            page.push_str("<ul>");
            for child in &children[idx] {
                self.render_node(page, *child, children);
            }
            page.push_str("</ul>");
        }
        page.push_str("</li>");
    }
}

impl Node {
    fn take(&mut self, record: &NamedRecord) {
        match &record.change {
            NamedChange::Status { from, to } => self.change(record.now_secs, *from, *to),
            NamedChange::Failed(failure) => {
                self.n_failures += 1;
                if self.failures.len() < MAX_FAILURES {
                    self.failures.push((record.now_secs, failure.reason.to_string(), failure.detail.clone()));
                }
            }
            _ => {}
        }
    }

    fn change(&mut self, now_secs: f64, from: Status, to: Status) {
        if from == Status::Idle {
            if self.n_starts == 0 {
                self.first_secs = now_secs;
            }
            self.n_starts += 1;
            self.is_halted = false;
        }
        if let Some(since) = self.running_since_secs.take() {
            self.running_secs += now_secs - since;
        }
        match to {
            Status::Idle => self.is_halted = from == Status::Running,
            Status::Running => {
                self.running_since_secs = Some(now_secs);
                self.status = Some(to);
            }
            _ => self.status = Some(to),
        }
    }

    /// Class of the colour, glyph and word.
    fn shown(&self) -> (&'static str, &'static str, &'static str) {
        match self.status {
            _ if self.is_halted => ("open", "◼", "halted"),
            None => ("idle", "·", "never began"),
            Some(Status::Success) => ("good", "✓", "success"),
            Some(Status::Failure) => ("bad", "✕", "failure"),
            Some(Status::Skipped) => ("open", "⤼", "skipped"),
            Some(Status::Running) => ("open", "▶", "running"),
            Some(Status::Idle) => ("idle", "○", "idle"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sfg_tree::{Failure, NodeClass};

    fn definition(paths: &[&str]) -> Vec<(String, NodeDefinition)> {
        let node = |(id, path): (usize, &&str)| {
            let title = path.rsplit('/').next().unwrap_or_default().to_owned();
            let id = u32::try_from(id).unwrap_or_default();
            let definition =
                NodeDefinition { id, parent: None, kind: title.clone(), title, class: NodeClass::Action, location: 0 };
            ((*path).to_owned(), definition)
        };
        paths.iter().enumerate().map(node).collect()
    }

    fn record(now_secs: f64, path: &str, change: NamedChange) -> NamedRecord {
        NamedRecord { tick_idx: 1, now_secs, path: path.to_owned(), change }
    }

    fn status(from: Status, to: Status) -> NamedChange {
        NamedChange::Status { from, to }
    }

    fn page(outcome: &TreeOutcome) -> String {
        let mut page = String::new();
        outcome.render(&mut page);
        page
    }

    #[test]
    fn a_node_keeps_its_last_status_its_time_and_its_failures() {
        let mut outcome = TreeOutcome::new(definition(&["sequence", "sequence/<lift>", "sequence/pour"]));
        outcome.add(&[
            record(1.0, "sequence", status(Status::Idle, Status::Running)),
            record(1.0, "sequence/<lift>", status(Status::Idle, Status::Running)),
            record(3.5, "sequence/<lift>", NamedChange::Failed(Failure::new("slipped", "by <3 mm>"))),
            record(3.5, "sequence/<lift>", status(Status::Running, Status::Failure)),
            record(3.5, "sequence/<lift>", status(Status::Failure, Status::Idle)),
            record(4.0, "sequence", status(Status::Running, Status::Idle)),
        ]);
        let page = page(&outcome);
        assert!(page.contains("&lt;lift&gt;") && page.contains("by &lt;3 mm&gt;") && !page.contains("<lift>"), "{page}");
        assert!(page.contains("failure · from 1.00 s · ran 2.50 s"), "{page}");
        assert!(page.contains("halted · from 1.00 s · ran 3.00 s"), "{page}");
        assert!(page.contains("never began"), "{page}");
        assert_eq!(page.matches("<ul").count(), 2, "children are nested: {page}");
    }

    #[test]
    fn what_happens_often_is_counted_and_not_listed() {
        let mut outcome = TreeOutcome::new(definition(&["retry"]));
        for round in 0..9 {
            let at = f64::from(round);
            outcome.add(&[
                record(at, "retry", NamedChange::Failed(Failure::new("no_path", "blocked"))),
                record(at, "retry", status(Status::Idle, Status::Failure)),
                record(at, "retry", status(Status::Failure, Status::Idle)),
            ]);
        }
        let page = page(&outcome);
        assert!(page.contains("9 times") && page.contains("and 4 more failures"), "{page}");
    }

    #[test]
    fn a_reload_adds_nodes_and_forgets_nothing() {
        let mut outcome = TreeOutcome::new(definition(&["sequence", "sequence/lift"]));
        outcome.add(&[record(2.0, "sequence/lift", status(Status::Idle, Status::Success))]);
        outcome.extend(definition(&["sequence", "sequence/lift", "sequence/pour"]));
        let page = page(&outcome);
        assert!(page.contains("success · from 2.00 s") && page.contains("pour"), "{page}");
    }
}
