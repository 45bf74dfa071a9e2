//! The node kinds a tree can use.

use crate::action::{Action, Tick};
use crate::blackboard::{Accessor, Form};
use crate::builder;
use crate::literal::Literal;
use crate::models::{self, BuiltIn, Children};
use crate::port::{PortSpec, PortType, Value};
use crate::problem::BuildError;
use crate::queue::Queue;
use crate::spec::TreeSpec;
use crate::status::{Failure, reason};
use crate::tree::{Kind, Tree};
use std::any::{Any, TypeId};
use std::borrow::Cow;
use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

/// How many children a node has and what it does with them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NodeClass {
    /// One or more children.
    Control,
    /// Exactly one child.
    Decorator,
    /// No child; may take several ticks.
    Action,
    /// No child; done within a tick.
    Step,
    /// No child; holds or not, changes nothing.
    Condition,
    /// Another tree.
    Subtree,
}

/// What an action occupies while it runs. Two actions that share a part of it are never active at the same time.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Footprint {
    /// Not said. A reactive node then halts whatever runs before it starts the action; parallel branches are not held back.
    #[default]
    Undeclared,
    /// Names of arms, hands, cameras; empty when it occupies nothing.
    Parts(Vec<Cow<'static, str>>),
}

/// What is known about a node kind.
#[derive(Clone, Debug)]
pub struct NodeModel {
    /// Name in the file.
    pub name: Cow<'static, str>,
    /// What it does with children.
    pub class: NodeClass,
    /// Its ports.
    pub ports: Vec<PortSpec>,
    /// One sentence for the reader of a scenario.
    pub doc: Cow<'static, str>,
    /// What it occupies while it runs.
    pub footprint: Footprint,
    /// Reasons it can fail for, besides the tree's own ([`crate::reason`]); nothing when not said.
    pub reasons: Option<Vec<Cow<'static, str>>>,
    /// How long it usually takes, seconds.
    pub expected_secs: Option<f64>,
}

impl NodeModel {
    /// A kind of which nothing else is said.
    pub fn new(name: impl Into<Cow<'static, str>>, class: NodeClass, ports: Vec<PortSpec>) -> Self {
        let name = name.into();
        let (footprint, doc) = (Footprint::default(), Cow::Borrowed(""));
        Self { name, class, ports, doc, footprint, reasons: None, expected_secs: None }
    }

    pub(crate) fn with_doc(mut self, doc: &'static str) -> Self {
        self.doc = Cow::Borrowed(doc);
        self
    }

    /// Says what the action occupies while it runs: names of arms, hands, cameras.
    pub fn occupies<P: Into<Cow<'static, str>>>(&mut self, parts: impl IntoIterator<Item = P>) -> &mut Self {
        self.footprint = Footprint::Parts(parts.into_iter().map(Into::into).collect());
        self
    }

    /// Says every reason the node can fail for, besides the tree's own: what waits for another one below it is then a mistake.
    pub fn fails_with<R: Into<Cow<'static, str>>>(&mut self, reasons: impl IntoIterator<Item = R>) -> &mut Self {
        self.reasons = Some(reasons.into_iter().map(Into::into).collect());
        self
    }

    /// Says how long the action usually takes.
    pub fn takes_secs(&mut self, expected_secs: f64) -> &mut Self {
        self.expected_secs = Some(expected_secs);
        self
    }

    /// Sets the sentence for the reader of a scenario.
    pub fn doc(&mut self, doc: impl Into<Cow<'static, str>>) -> &mut Self {
        self.doc = doc.into();
        self
    }
}

pub(crate) type Predicate<C> = Arc<dyn Fn(&mut Tick<'_, C>) -> Result<bool, Failure> + Send + Sync>;
pub(crate) type StepFn<C> = Arc<dyn Fn(&mut Tick<'_, C>) -> Result<(), Failure> + Send + Sync>;
type ActionFactory<C> = Arc<dyn Fn() -> Box<dyn Action<C>> + Send + Sync>;

/// Makes a leaf.
pub(crate) enum Factory<C> {
    BuiltIn(Kind, Children),
    Action(ActionFactory<C>),
    Condition(Predicate<C>),
    Step(StepFn<C>),
}

/// Node kinds, fields of values and entries provided by the application.
pub struct Registry<C> {
    pub(crate) models: Arc<Vec<NodeModel>>,
    pub(crate) factories: Vec<Factory<C>>,
    pub(crate) defaults: Vec<Vec<Option<Value>>>,
    pub(crate) fields: BTreeMap<(TypeId, String), (PortType, Accessor)>,
    pub(crate) entries: Vec<(String, PortType)>,
    pub(crate) lists: Vec<ListType>,
    pub(crate) forms: Arc<HashMap<TypeId, Form>>,
}

/// How a `loop` goes over a type: the item of a number, or the next of a queue; nothing when the value is of another type.
#[derive(Clone)]
pub(crate) struct ListType {
    pub(crate) next: fn(&(dyn Any + Send + Sync), usize) -> Option<Option<Value>>,
}

impl<C> Default for Registry<C> {
    fn default() -> Self {
        Self::new()
    }
}

impl<C> Registry<C> {
    /// The built-in controls and decorators only.
    #[must_use]
    pub fn new() -> Self {
        let (fields, entries) = (BTreeMap::new(), Vec::new());
        let (models, factories, defaults, lists) = (Arc::new(Vec::new()), Vec::new(), Vec::new(), Vec::new());
        let forms = Arc::new(HashMap::new());
        let mut registry = Self { models, factories, defaults, fields, entries, lists, forms };
        for BuiltIn { kind, children, mut model } in models::built_in() {
            if !matches!(model.class, NodeClass::Control | NodeClass::Decorator) {
                model.reasons = Some(Vec::new());
            }
            registry.add(model, Factory::BuiltIn(kind, children));
        }
        registry.list::<bool>();
        registry.list::<i32>();
        registry.list::<i64>();
        registry.list::<u32>();
        registry.list::<f64>();
        registry.list::<String>();
        registry
    }

    /// Adds an action; `make` is called once for each node of the tree.
    ///
    /// # Panics
    /// If the name is taken or a default does not fit its port.
    pub fn action<A: Action<C> + 'static>(
        &mut self,
        name: impl Into<Cow<'static, str>>,
        ports: impl IntoIterator<Item = PortSpec>,
        make: impl Fn() -> A + Send + Sync + 'static,
    ) -> &mut NodeModel {
        let factory = Factory::Action(Arc::new(move || Box::new(make())));
        self.add(leaf(name, NodeClass::Action, ports), factory)
    }

    /// Adds a condition: success when it holds, failure with [`crate::reason::CONDITION_FALSE`] when not. It must change nothing.
    ///
    /// # Panics
    /// If the name is taken or a default does not fit its port.
    pub fn condition(
        &mut self,
        name: impl Into<Cow<'static, str>>,
        ports: impl IntoIterator<Item = PortSpec>,
        holds: impl Fn(&mut Tick<'_, C>) -> Result<bool, Failure> + Send + Sync + 'static,
    ) -> &mut NodeModel {
        self.add(leaf(name, NodeClass::Condition, ports), Factory::Condition(Arc::new(holds)))
    }

    /// Adds an action that is done within one call.
    ///
    /// # Panics
    /// If the name is taken or a default does not fit its port.
    pub fn step(
        &mut self,
        name: impl Into<Cow<'static, str>>,
        ports: impl IntoIterator<Item = PortSpec>,
        run: impl Fn(&mut Tick<'_, C>) -> Result<(), Failure> + Send + Sync + 'static,
    ) -> &mut NodeModel {
        self.add(leaf(name, NodeClass::Step, ports), Factory::Step(Arc::new(run)))
    }

    /// Lets scenarios write `"{key.name}"` where `key` holds a `P`.
    pub fn field<P: Any + Send + Sync, T: Any + Send + Sync>(
        &mut self,
        name: impl Into<String>,
        get: impl Fn(&P) -> Result<T, Failure> + Send + Sync + 'static,
    ) {
        let name = name.into();
        let accessor: Accessor = Arc::new(move |value: &(dyn Any + Send + Sync)| {
            let Some(value) = value.downcast_ref::<P>() else {
                return Err(Failure::new(reason::PANICKED, "a field was read from another type than it was checked for"));
            };
            Ok(Arc::new(get(value)?) as Value)
        });
        self.fields.insert((TypeId::of::<P>(), name), (PortType::shared::<T>(), accessor));
    }

    /// Lets a `loop` go over a `Vec<T>` and a [`Queue<T>`](crate::Queue).
    pub fn list<T: Any + Send + Sync + Clone>(&mut self) {
        self.lists.push(ListType {
            next: |value, item_idx| {
                if let Some(list) = value.downcast_ref::<Vec<T>>() {
                    return Some(list.get(item_idx).map(|item| Arc::new(item.clone()) as Value));
                }
                value.downcast_ref::<Queue<T>>().map(|queue| queue.pop().map(|item| Arc::new(item) as Value))
            },
        });
    }

    /// Says how values of a type that files cannot give are written down and read back, so that a saved tree and a journal
    /// with values hold them.
    pub fn literal_form<T: Any + Send + Sync>(
        &mut self,
        to: impl Fn(&T) -> Option<Literal> + Send + Sync + 'static,
        from: impl Fn(&Literal) -> Result<T, String> + Send + Sync + 'static,
    ) {
        self.add_form(to, from, true);
    }

    /// The same for values that are too large for a journal: only a saved tree holds them.
    pub fn saved_form<T: Any + Send + Sync>(
        &mut self,
        to: impl Fn(&T) -> Option<Literal> + Send + Sync + 'static,
        from: impl Fn(&Literal) -> Result<T, String> + Send + Sync + 'static,
    ) {
        self.add_form(to, from, false);
    }

    fn add_form<T: Any + Send + Sync>(
        &mut self,
        to: impl Fn(&T) -> Option<Literal> + Send + Sync + 'static,
        from: impl Fn(&Literal) -> Result<T, String> + Send + Sync + 'static,
        is_in_journal: bool,
    ) {
        let to = Arc::new(move |value: &(dyn Any + Send + Sync)| value.downcast_ref::<T>().and_then(&to));
        let from = Arc::new(move |literal: &Literal| from(literal).map(|value| Arc::new(value) as Value));
        Arc::make_mut(&mut self.forms).insert(TypeId::of::<T>(), Form { to, from, is_in_journal });
    }

    /// Declares a blackboard entry of the root scope that the application sets before the first tick.
    pub fn entry<T: Any + Send + Sync>(&mut self, key: impl Into<String>) {
        self.entries.push((key.into(), PortType::shared::<T>()));
    }

    /// Every node kind, built-in ones first.
    #[must_use]
    pub fn models(&self) -> &[NodeModel] {
        &self.models
    }

    /// The keys that the application sets before the first tick.
    pub fn entry_keys(&self) -> impl Iterator<Item = &str> {
        self.entries.iter().map(|(key, _)| key.as_str())
    }

    /// A tree, checked as a whole.
    ///
    /// # Errors
    /// Every mistake of `spec`, in the order of its nodes.
    pub fn build(&self, spec: &TreeSpec) -> Result<Tree<C>, Vec<BuildError>> {
        builder::build(self, spec)
    }

    pub(crate) fn find(&self, name: &str) -> Option<usize> {
        self.models.iter().position(|model| model.name == name)
    }

    fn add(&mut self, model: NodeModel, factory: Factory<C>) -> &mut NodeModel {
        assert!(self.find(&model.name).is_none(), "node {:?} is registered twice", model.name);
        let convert = |port: &PortSpec| {
            port.default.as_ref().map(|literal| match port.value_of(literal) {
                Ok(value) => value,
                Err(message) => panic!("default of port {:?} of node {:?}: {message}", port.name, model.name),
            })
        };
        self.defaults.push(model.ports.iter().map(convert).collect());
        self.factories.push(factory);
        let models = Arc::make_mut(&mut self.models);
        models.push(model);
        let last = models.len() - 1;
        &mut models[last]
    }
}

fn leaf(name: impl Into<Cow<'static, str>>, class: NodeClass, ports: impl IntoIterator<Item = PortSpec>) -> NodeModel {
    NodeModel::new(name, class, ports.into_iter().collect())
}
