//! Reasons that a `retry` or `recover` waits for and that nothing below it gives.

use crate::mistake::{Mistake, Place};
use crate::review::Reviewed;
use sfg_tree::{Literal, NodeClass, NodeKind, NodeSpec, PortValue, SubtreeSpec, nearest};
use std::collections::{BTreeMap, BTreeSet};

/// Where a reason stands: the number of its node's place, the reason and its own place.
pub(crate) type ReasonPlace = (u32, String, Place);

/// What the leaves below a node fail for, besides the tree's own reasons; nothing when one of them does not say.
type Given<'a> = Option<BTreeSet<&'a str>>;

/// Stands for every reason.
pub(crate) const ANY: &str = "any";

pub(crate) struct Reasons<'a, 'm> {
    reviewed: &'m Reviewed<'a>,
    subtrees: &'m BTreeMap<&'a str, &'a SubtreeSpec>,
    known: BTreeMap<&'a str, Given<'a>>,
}

impl<'a, 'm> Reasons<'a, 'm> {
    pub(crate) fn new(reviewed: &'m Reviewed<'a>, subtrees: &'m BTreeMap<&'a str, &'a SubtreeSpec>) -> Self {
        Self { reviewed, subtrees, known: BTreeMap::new() }
    }

    pub(crate) fn check(mut self, mistakes: &mut Vec<Mistake>) {
        for (_, root) in self.reviewed.roots() {
            self.check_node(root, mistakes);
        }
    }

    fn check_node(&mut self, node: &'a NodeSpec, mistakes: &mut Vec<Mistake>) {
        if let NodeKind::Named(kind) = &node.kind
            && ["retry", "recover"].contains(&kind.as_str())
            // The other children of a `recover` are what it does about them.
            && let Some(given) = self.given_by(&node.children[..node.children.len().min(1)])
        {
            for reason in waited_for(node) {
                if given.contains(reason) || reason == ANY || sfg_tree::reason::ALL.contains(&reason) {
                    continue;
                }
                let at = self.reviewed.reason_places.iter().find(|(number, text, _)| *number == node.location && text == reason);
                let place = at.map_or_else(|| self.reviewed.place(node.location), |(_, _, place)| *place);
                let message = format!("{kind:?} waits for {reason:?}, which nothing below it fails for");
                let help = match nearest(reason, given.iter().copied()) {
                    Some(near) => format!("remove it, or did you mean {near:?}?"),
                    None => "remove it".to_owned(),
                };
                mistakes.push(Mistake::warning(place, message).help(help));
            }
        }
        for child in &node.children {
            self.check_node(child, mistakes);
        }
    }

    fn given_by(&mut self, nodes: &'a [NodeSpec]) -> Given<'a> {
        // Children that are missing are another mistake.
        if nodes.is_empty() {
            return None;
        }
        nodes.iter().try_fold(BTreeSet::new(), |mut all, node| {
            all.extend(self.given(node)?);
            Some(all)
        })
    }

    fn given(&mut self, node: &'a NodeSpec) -> Given<'a> {
        if let NodeKind::Subtree(name) = &node.kind {
            if let Some(known) = self.known.get(name.as_str()) {
                return known.clone();
            }
            let given = self.subtrees.get(name.as_str()).and_then(|subtree| self.given(&subtree.root));
            self.known.insert(name, given.clone());
            return given;
        }
        let model = self.reviewed.model(node)?;
        match model.class {
            NodeClass::Control | NodeClass::Decorator => self.given_by(&node.children),
            _ => Some(model.reasons.as_ref()?.iter().map(AsRef::as_ref).collect()),
        }
    }
}

/// The reasons that are written at a node.
fn waited_for(node: &NodeSpec) -> impl Iterator<Item = &str> {
    let on = node.ports.iter().find(|setting| setting.name == "on");
    let items = match on.map(|setting| &setting.value) {
        Some(PortValue::Literal(Literal::List(items))) => items.as_slice(),
        _ => &[],
    };
    items.iter().filter_map(|item| match item {
        Literal::Text(text) => Some(text.as_str()),
        _ => None,
    })
}
