//! Which blackboard entries a subtree has. A tree knows only slots; the formats of Groot2 have one blackboard per subtree.

use crate::tree::{Kind, NONE, NodeId, Tree};
use std::collections::{BTreeMap, BTreeSet};

/// The name of the main tree.
pub(super) const MAIN: &str = "MainTree";

/// The main tree or one use of a subtree.
#[derive(Clone, Debug, Default)]
pub(super) struct Scope {
    /// The subtree node; nothing for the main tree.
    pub(super) node: Option<NodeId>,
    /// The scope around it.
    pub(super) parent: Option<usize>,
    /// How messages call it: [`MAIN`], or the path of the subtree node.
    pub(super) name: String,
    /// Its entries and those of scopes around it that its nodes use: slot and name inside.
    pub(super) keys: BTreeMap<u32, String>,
    /// Those of scopes around it.
    pub(super) connected: BTreeSet<u32>,
}

/// The scopes of a tree, the main tree's first.
#[derive(Clone, Debug, Default)]
pub(super) struct Scopes {
    pub(super) list: Vec<Scope>,
    /// The scope that the ports of a node see, by node.
    pub(super) of_node: Vec<usize>,
}

impl Scopes {
    /// `paths` are the unique paths of the nodes.
    pub(super) fn new<C>(tree: &Tree<C>, paths: &[String]) -> Self {
        let mut scopes = Self { list: vec![Scope { name: MAIN.to_owned(), ..Scope::default() }], of_node: Vec::new() };
        // The scope below each subtree node, and those by the paths that keys of slots begin with: not unique.
        let mut below: BTreeMap<NodeId, usize> = BTreeMap::new();
        let mut by_path: BTreeMap<String, Vec<usize>> = BTreeMap::new();
        for (node, id) in tree.nodes.iter().zip(0..) {
            let scope = match node.parent {
                NONE => 0,
                parent => below.get(&parent).copied().unwrap_or_else(|| scopes.of_node[parent as usize]),
            };
            scopes.of_node.push(scope);
            if node.kind == Kind::Subtree {
                below.insert(id, scopes.list.len());
                by_path.entry(tree.path(id)).or_default().push(scopes.list.len());
                let name = paths.get(id as usize).cloned().unwrap_or_default();
                scopes.list.push(Scope { node: Some(id), parent: Some(scope), name, ..Scope::default() });
            }
        }
        let uses = scopes.uses(tree);
        let owners = scopes.owners(tree, &by_path, &uses);
        for (slot, owner) in (0..).zip(&owners) {
            if let Some((owner, key)) = owner {
                scopes.list[*owner].keys.insert(slot, (*key).to_owned());
            }
        }
        for (scope, slot) in uses {
            scopes.connect(scope, slot, &owners);
        }
        scopes
    }

    /// The slots behind ports, with the scope of the node.
    fn uses<C>(&self, tree: &Tree<C>) -> BTreeSet<(usize, u32)> {
        let mut uses = BTreeSet::new();
        for (node, scope) in tree.nodes.iter().zip(&self.of_node) {
            let n_ports = tree.models.get(node.model as usize).map_or(0, |model| model.ports.len());
            let sources = tree.sources.iter().skip(node.first_source as usize).take(n_ports);
            uses.extend(sources.filter_map(|source| Some((*scope, source.slot()?))));
        }
        uses
    }

    /// The scope and key of each slot; nothing for those of subtrees that are not used.
    fn owners<'t, C>(
        &self,
        tree: &'t Tree<C>,
        by_path: &BTreeMap<String, Vec<usize>>,
        uses: &BTreeSet<(usize, u32)>,
    ) -> Vec<Option<(usize, &'t str)>> {
        let mut users: BTreeMap<u32, Vec<usize>> = BTreeMap::new();
        for (scope, slot) in uses {
            users.entry(*slot).or_default().push(*scope);
        }
        // Of subtrees with the same path, slots that no port uses follow the one before, and a key that comes again is the next's.
        let mut last: BTreeMap<&str, (usize, BTreeSet<&str>)> = BTreeMap::new();
        let owner_of = |(key, slot): (&'t String, u32)| {
            let Some((path, key)) = key.rsplit_once(':') else { return Some((0, key.as_str())) };
            let candidates = by_path.get(path)?;
            let (at, seen) = last.entry(path).or_default();
            let used = users.get(&slot).and_then(|users| self.around(*users.first()?).find(|scope| candidates.contains(scope)));
            let next = match used.and_then(|scope| candidates.iter().position(|candidate| *candidate == scope)) {
                Some(next) => next,
                None if seen.contains(key) => (*at + 1).min(candidates.len() - 1),
                None => *at,
            };
            if next != *at {
                *at = next;
                seen.clear();
            }
            seen.insert(key);
            Some((candidates[next], key))
        };
        tree.slot_keys.iter().zip(0..).map(owner_of).collect()
    }

    /// A scope and those around it, from the inside.
    fn around(&self, scope: usize) -> impl Iterator<Item = usize> + '_ {
        std::iter::successors(Some(scope), |scope| self.list[*scope].parent)
    }

    /// Gives a slot a name in a scope and in those between it and the slot's own.
    fn connect(&mut self, scope: usize, slot: u32, owners: &[Option<(usize, &str)>]) {
        let Some((owner, key)) = owners.get(slot as usize).copied().flatten() else { return };
        let between: Vec<usize> = self.around(scope).take_while(|scope| *scope != owner).collect();
        for scope in between {
            let scope = &mut self.list[scope];
            if scope.connected.insert(slot) {
                let mut name = key.to_owned();
                while scope.keys.values().any(|taken| *taken == name) {
                    name.push('_');
                }
                scope.keys.insert(slot, name);
            }
        }
    }

    /// The scope of a subtree node.
    pub(super) fn below(&self, node: NodeId) -> Option<&Scope> {
        let at = self.list.binary_search_by_key(&Some(node), |scope| scope.node).ok()?;
        self.list.get(at)
    }

    /// The name of a slot in a scope.
    pub(super) fn key(&self, scope: usize, slot: u32) -> Option<&str> {
        self.list.get(scope)?.keys.get(&slot).map(String::as_str)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::port::Direction;
    use crate::registry::Registry;
    use crate::spec::{NodeSpec, SubtreePort, SubtreeSpec, TreeSpec};

    /// Scopes as `name: key key`, keys in the order of their slots.
    fn scopes(root: NodeSpec, subtrees: Vec<SubtreeSpec>) -> Vec<String> {
        let spec = TreeSpec { subtrees, allows_unwritten_keys: true, ..TreeSpec::new(root) };
        let Ok(tree) = Registry::<()>::new().build(&spec) else { panic!("the tree is good") };
        let scopes = Scopes::new(&tree, &tree.unique_paths());
        let text = |scope: &Scope| {
            let keys: Vec<&str> = scope.keys.values().map(String::as_str).collect();
            format!("{}: {}", scope.name, keys.join(" "))
        };
        scopes.list.iter().map(text).collect()
    }

    fn subtree(name: &str, root: NodeSpec, ports: &[&str]) -> SubtreeSpec {
        let port =
            |name: &&str| SubtreePort { name: (*name).to_owned(), direction: Direction::InOut, default: None, location: 0 };
        SubtreeSpec { name: name.to_owned(), ports: ports.iter().map(port).collect(), root, ..SubtreeSpec::default() }
    }

    fn set(key: &str) -> NodeSpec {
        NodeSpec::new("set_blackboard").with("value", 1).with_key("output_key", key)
    }

    #[test]
    fn a_subtree_used_twice_has_two_blackboards() {
        let root = NodeSpec::new("sequence").child(NodeSpec::subtree("count")).child(NodeSpec::subtree("count"));
        let by_ports = subtree("count", NodeSpec::new("sequence").child(set("a")).child(set("b")), &[]);
        let expected = ["MainTree: ", "sequence/count: a b", "sequence/count#2: a b"];
        assert_eq!(scopes(root.clone(), vec![by_ports]), expected);
        let by_scripts = subtree("count", NodeSpec::new("script").with("code", "a := 1; b := a"), &[]);
        assert_eq!(scopes(root, vec![by_scripts]), expected);
    }

    #[test]
    fn a_connected_key_is_in_every_scope_on_its_way() {
        let inner = subtree("inner", set("found"), &["found"]);
        let outer = subtree("outer", NodeSpec::new("sequence").child(NodeSpec::subtree("inner")).child(set("own")), &["found"]);
        let root = NodeSpec::subtree("outer").with_key("found", "left");
        let expected = ["MainTree: left", "outer: left own", "outer/sequence/inner: left"];
        assert_eq!(scopes(root, vec![inner, outer]), expected);
    }
}
