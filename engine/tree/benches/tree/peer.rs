//! The trees of [`crate::trees`] for the crate `bonsai-bt` (MIT). Its blackboard is the user's; here it is a hash map by name.
//!
//! A tree of it that has ended must be reset before the next tick; the time of that is part of every sample. Names of entries
//! are `&'static str` in its leaves, which is less than a tree from a file would hold.

use crate::trees::{Cloud, Context, N_CONDITIONS, N_COUNTERS, N_LEAVES};
use bonsai_bt::{Action, ActionArgs, BT, Behavior, Event, Failure, RUNNING, Sequence, Status, Success, UpdateArgs};
use std::collections::HashMap;
use std::sync::Arc;

#[derive(Clone, Debug)]
pub(crate) enum Leaf {
    Work,
    Holds,
    Agrees(&'static str),
    Wait,
    Add { from: &'static str, to: &'static str },
    See(&'static str),
    Look(&'static str),
}

pub(crate) enum Entry {
    Flag(bool),
    Counter(u64),
    Cloud(Arc<Cloud>),
}

pub(crate) type Board = HashMap<&'static str, Entry>;

pub(crate) fn rows(n_rows: usize, leaf: impl Fn(usize) -> Leaf) -> Behavior<Leaf> {
    let row = |row_idx: usize| Sequence((0..9).map(|column| Action(leaf(row_idx * 9 + column))).collect());
    Sequence((0..n_rows).map(row).collect())
}

pub(crate) fn flat(leaf: impl Fn(usize) -> Leaf) -> Behavior<Leaf> {
    Sequence((0..N_LEAVES).map(|leaf_idx| Action(leaf(leaf_idx))).collect())
}

pub(crate) fn reactive(condition: impl Fn(usize) -> Leaf) -> Behavior<Leaf> {
    let conditions = (0..N_CONDITIONS).map(|condition_idx| Action(condition(condition_idx)));
    Sequence(conditions.chain([Action(Leaf::Wait)]).collect()).memory(false)
}

pub(crate) fn mixed(leaf_idx: usize) -> Leaf {
    if leaf_idx.is_multiple_of(2) { Leaf::Work } else { Leaf::Holds }
}

/// Leaves as [`crate::trees::counting`] has them.
pub(crate) fn counting(names: &[&'static str]) -> impl Fn(usize) -> Leaf {
    |leaf_idx| Leaf::Add { from: names[leaf_idx % N_COUNTERS], to: names[(leaf_idx + 1) % N_COUNTERS] }
}

/// `counter_0`, ... for the life of the program.
pub(crate) fn names(stem: &str, n: usize) -> Vec<&'static str> {
    (0..n).map(|number| &*format!("{stem}_{number}").leak()).collect()
}

/// One tick, after which the tree can be ticked again.
pub(crate) fn tick(tree: &mut BT<Leaf, Board>, context: &mut Context) -> Status {
    let tick_idx = tree.tick_count() + 1;
    let event: Event = UpdateArgs { dt: 0.01 }.into();
    let (status, _dt) = tree.tick(&event, &mut |args, board| leaf(&args, board, tick_idx, context)).unwrap();
    if status != Status::Running {
        tree.reset_bt();
    }
    status
}

#[inline]
fn leaf(args: &ActionArgs<'_, Event, Leaf>, board: &mut Board, tick_idx: u64, context: &mut Context) -> (Status, f64) {
    let holds = match args.action {
        Leaf::Work => {
            context.sum = context.sum.wrapping_mul(31).wrapping_add(tick_idx);
            true
        }
        Leaf::Holds => {
            context.sum = context.sum.wrapping_add(1);
            context.sum != 0
        }
        Leaf::Agrees(key) => {
            let Some(Entry::Flag(flag)) = board.get(key) else { return (Failure, args.dt) };
            context.sum = context.sum.wrapping_add(u64::from(*flag));
            *flag == context.flag
        }
        Leaf::Wait => {
            context.sum = context.sum.wrapping_add(tick_idx);
            return RUNNING;
        }
        Leaf::Add { from, to } => {
            let Some(Entry::Counter(counter)) = board.get(from) else { return (Failure, args.dt) };
            let sum = counter.wrapping_add(1);
            board.insert(to, Entry::Counter(sum));
            context.sum = context.sum.wrapping_add(sum);
            true
        }
        Leaf::See(key) => {
            let cloud_idx = context.sum as usize % context.clouds.len();
            board.insert(key, Entry::Cloud(Arc::clone(&context.clouds[cloud_idx])));
            true
        }
        Leaf::Look(key) => {
            let Some(Entry::Cloud(cloud)) = board.get(key) else { return (Failure, args.dt) };
            let cloud = Arc::clone(cloud);
            context.sum = context.sum.wrapping_add(cloud.len() as u64);
            true
        }
    };
    (if holds { Success } else { Failure }, args.dt)
}
