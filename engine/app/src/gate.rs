//! Between two ticks the run asks what the page's user wants.

use sfg_monitor::{At, Control, Go, Hit};
use sfg_skills::{Robot, SkillContext};
use sfg_tree::{BreakAt, Failure, NodeId, Tree};

/// Reason of a failure that was asked for on the page.
const FORCED: &str = "forced";

/// The gate of one run.
pub(crate) struct Gate<'a> {
    control: &'a Control,
    /// Time in which the robot was held since the last tick, and in the whole run.
    held_secs: (f64, f64),
}

impl<'a> Gate<'a> {
    /// The gate to `tree`.
    pub(crate) fn new(control: &'a Control, tree: &Tree<SkillContext>) -> Self {
        let gate = Self { control, held_secs: (0.0, 0.0) };
        gate.show(tree);
        gate
    }

    /// Tells the page's user which nodes there are, at the start and after a reload.
    pub(crate) fn show(&self, tree: &Tree<SkillContext>) {
        let names = tree.names();
        self.control.set_nodes(tree.definition().map(|node| names.path(node.id).to_owned()));
    }

    /// Time in which the robot was held, of the whole run.
    pub(crate) fn held_secs(&self) -> f64 {
        self.held_secs.1
    }

    /// What comes next; prepares the tree for its tick.
    pub(crate) fn before_tick(&mut self, tree: &mut Tree<SkillContext>, robot: &Robot) -> Go {
        // What goes on in the middle of a ramp to rest would jerk, and so would a motion that follows one cut short.
        let needs_rest = self.held_secs.0 > 0.0 || self.control.has_forced();
        if needs_rest && !robot.is_at_rest() && !self.control.is_ending() {
            return self.hold(robot);
        }
        let turn = self.control.turn();
        if turn.go == Go::Hold {
            return self.hold(robot);
        }
        if let Some(breakpoints) = &turn.breakpoints {
            let at = |point: &sfg_monitor::Breakpoint| BreakAt { start: point.start, end: point.end };
            let breaks: Vec<(NodeId, BreakAt)> =
                breakpoints.iter().filter_map(|point| Some((tree.node_at(&point.node)?, at(point)))).collect();
            tree.set_breaks(breaks);
        }
        for forced in &turn.forced {
            if let Some(node) = tree.node_at(&forced.node) {
                let failure = || Failure::new(FORCED, "asked for on the page");
                tree.force(node, if forced.success { Ok(()) } else { Err(failure()) });
            }
        }
        if self.held_secs.0 > 0.0 {
            tree.postpone(self.held_secs.0);
            self.held_secs.0 = 0.0;
        }
        turn.go
    }

    fn hold(&mut self, robot: &Robot) -> Go {
        self.held_secs.0 += robot.period_secs();
        self.held_secs.1 += robot.period_secs();
        Go::Hold
    }

    /// Tells how a tick went.
    pub(crate) fn after_tick(&self, tree: &mut Tree<SkillContext>, has_changes: bool) {
        let met = tree.take_breaks();
        let hits = met
            .into_iter()
            .map(|met| Hit { node: tree.names().path(met.node).to_owned(), at: if met.is_end { At::End } else { At::Start } });
        let hits: Vec<Hit> = hits.collect();
        self.control.ticked(has_changes, &hits);
    }
}
