//! Which cluster of the inventory a noun phrase means.

use crate::knowledge::{Knowledge, Thing};
use crate::sentence::{Attributes, Head, NounPhrase};
use crate::words::{Axis, Measure, colour_word};
use sfg_types::{ColourName, ObjectCluster, SceneInventory};

/// Worse than this is not the thing that was named.
pub(crate) const FLOOR: f64 = 0.20;
/// A second choice this near to the best leaves the sentence open.
pub(crate) const AMBIGUOUS: f64 = 0.80;
/// A word for "any of them" fits everything this well.
const GENERIC_FIT: f64 = 0.6;
/// A name that merely looks alike is worth this much of its score.
const LOOKALIKE: f64 = 0.75;
/// Each next name in the list of names a thing may be taken for.
const NEXT_LOOKALIKE: f64 = 0.5;
/// Each next vessel in the list of a content, each next tool of a verb.
const NEXT_BEST: f64 = 0.75;

/// How well one cluster fits a phrase.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Fit {
    pub(crate) cluster_id: u32,
    /// Fit of the noun, 0 to 1.
    pub(crate) name: f64,
    /// Fit of colour, size and place words among the clusters whose name fits, 0 to 1.
    pub(crate) attributes: f64,
}

impl Fit {
    pub(crate) fn total(&self) -> f64 {
        self.name * self.attributes
    }
}

/// The clusters in the light of the knowledge.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Scene<'a> {
    pub(crate) inventory: &'a SceneInventory,
    pub(crate) knowledge: &'a Knowledge,
}

impl<'a> Scene<'a> {
    /// All clusters that fit the phrase, best first.
    pub(crate) fn fits(&self, phrase: &NounPhrase) -> Vec<Fit> {
        let names = |cluster: &ObjectCluster| match &phrase.head {
            Some(Head::Thing(i)) => self.thing_score(cluster, &self.knowledge.things[*i]),
            Some(Head::Seen(name)) => plain_score(cluster, name),
            Some(Head::Content(i)) => self.list_score(cluster, &self.knowledge.small.contents[*i].vessels),
            Some(Head::Generic(i)) => self.generic_score(cluster, &self.knowledge.small.generic[*i].kinds),
            None => GENERIC_FIT,
            Some(Head::Part(_) | Head::Person | Head::Unknown(_)) => 0.0,
        };
        self.ranked(names, &phrase.attributes)
    }

    /// Clusters ranked by a score of their own, then by attributes.
    pub(crate) fn ranked(&self, score: impl Fn(&ObjectCluster) -> f64, attributes: &Attributes) -> Vec<Fit> {
        let candidates: Vec<(&ObjectCluster, f64)> =
            self.inventory.clusters.iter().map(|cluster| (cluster, score(cluster))).filter(|(_, name)| *name >= FLOOR).collect();
        let peers: Vec<&ObjectCluster> = candidates.iter().map(|(cluster, _)| *cluster).collect();
        let mut fits: Vec<Fit> = candidates
            .iter()
            .map(|(cluster, name)| Fit {
                cluster_id: cluster.id,
                name: *name,
                attributes: self.attribute_fit(cluster, attributes, &peers),
            })
            .collect();
        fits.sort_by(|a, b| b.total().total_cmp(&a.total()).then(a.cluster_id.cmp(&b.cluster_id)));
        fits
    }

    /// How well the cluster may be a thing of this category.
    pub(crate) fn thing_score(&self, cluster: &ObjectCluster, thing: &Thing) -> f64 {
        let own =
            cluster.names.iter().filter(|ranked| thing.is_called(&ranked.name)).map(|ranked| ranked.score).fold(0.0, f64::max);
        // A name counts less where the cameras prefer another one.
        let top = cluster.names.first().map_or(1.0, |ranked| ranked.score.max(1e-6));
        let alike = cluster.names.iter().filter_map(|ranked| {
            let place = thing.looks_like.iter().position(|name| self.same_thing(name, &ranked.name))?;
            Some(ranked.score * (ranked.score / top).sqrt() * LOOKALIKE * NEXT_LOOKALIKE.powi(place as i32))
        });
        alike.fold(own, f64::max)
    }

    /// How well the cluster may be one of these things, the first one best.
    pub(crate) fn list_score(&self, cluster: &ObjectCluster, names: &[String]) -> f64 {
        let scores = names.iter().enumerate().map(|(i, name)| {
            let score = self.knowledge.thing(name).map_or_else(|| plain_score(cluster, name), |thing| own_score(cluster, thing));
            score * NEXT_BEST.powi(i as i32)
        });
        scores.fold(0.0, f64::max)
    }

    /// The category by which the cluster is best called, if the knowledge has it.
    pub(crate) fn best_thing(&self, cluster: &ObjectCluster) -> Option<&'a Thing> {
        cluster.names.first().and_then(|ranked| self.knowledge.thing(&ranked.name))
    }

    fn same_thing(&self, a: &str, b: &str) -> bool {
        a == b || self.knowledge.thing(a).is_some_and(|thing| thing.is_called(b))
    }

    fn generic_score(&self, cluster: &ObjectCluster, kinds: &[String]) -> f64 {
        let fits = kinds.is_empty()
            || self.best_thing(cluster).map_or_else(
                || self.knowledge.kind_of_shape(cluster.shape).is_some_and(|kind| kinds.contains(&kind.name)),
                |thing| kinds.contains(&thing.kind),
            );
        if fits { GENERIC_FIT } else { 0.0 }
    }

    fn attribute_fit(&self, cluster: &ObjectCluster, attributes: &Attributes, peers: &[&ObjectCluster]) -> f64 {
        let mut fit = 1.0;
        if let Some(best) = attributes.colours.iter().map(|&asked| colour_fit(asked, cluster.colour)).reduce(f64::max) {
            fit *= best;
        }
        for &i in &attributes.sizes {
            let size = &self.knowledge.small.sizes[i];
            fit *= standing(cluster, peers, |c| size.sign * measure(c, size.measure), 0.004);
        }
        for &i in &attributes.places {
            let place = &self.knowledge.small.places[i];
            let along =
                |c: &ObjectCluster| place.sign * if place.axis == Axis::X { c.centre_in_base.x } else { c.centre_in_base.y };
            fit *= standing(cluster, peers, along, 0.02);
        }
        fit
    }

    /// A short description that tells the cluster from the others: colour and name, the place where that is not enough.
    pub(crate) fn describe(&self, cluster: &ObjectCluster) -> String {
        let plain = |c: &ObjectCluster| {
            format!("the {} {}", colour_word(c.colour), c.names.first().map_or("thing", |ranked| ranked.name.as_str()))
        };
        let own = plain(cluster);
        let twins: Vec<&ObjectCluster> = self.inventory.clusters.iter().filter(|c| plain(c) == own).collect();
        if twins.len() < 2 {
            return own;
        }
        // From left to right, as the robot sees it.
        let place = twins.iter().filter(|c| c.centre_in_base.y > cluster.centre_in_base.y).count();
        match place {
            0 => format!("{own} on the left"),
            last if last + 1 == twins.len() => format!("{own} on the right"),
            1 if twins.len() == 3 => format!("{own} in the middle"),
            middle => format!("{own}, number {} from the left", middle + 1),
        }
    }

    /// What is there, for refusals.
    pub(crate) fn listing(&self) -> String {
        let names: Vec<String> =
            self.inventory.clusters.iter().map(|cluster| self.describe(cluster).replacen("the ", "a ", 1)).collect();
        match names.as_slice() {
            [] => "an empty table".to_owned(),
            [one] => one.clone(),
            [rest @ .., last] => format!("{} and {last}", rest.join(", ")),
        }
    }
}

fn plain_score(cluster: &ObjectCluster, name: &str) -> f64 {
    cluster.names.iter().find(|ranked| ranked.name == name).map_or(0.0, |ranked| ranked.score)
}

fn own_score(cluster: &ObjectCluster, thing: &Thing) -> f64 {
    cluster.names.iter().filter(|ranked| thing.is_called(&ranked.name)).map(|ranked| ranked.score).fold(0.0, f64::max)
}

fn measure(cluster: &ObjectCluster, measure: Measure) -> f64 {
    let size = &cluster.size_m;
    match measure {
        Measure::Height => size.z,
        Measure::Length => size.x,
        Measure::Width => size.y,
        // A length again, so that one tolerance serves all.
        Measure::Volume => (size.x * size.y * size.z).cbrt(),
    }
}

/// 1 for the most, falling with the rank; ties within `tolerance` share the better rank.
fn standing(cluster: &ObjectCluster, peers: &[&ObjectCluster], value: impl Fn(&ObjectCluster) -> f64, tolerance: f64) -> f64 {
    let own = value(cluster);
    let n_better = peers.iter().filter(|peer| value(peer) > own + tolerance).count();
    0.4_f64.powi(n_better as i32)
}

/// 1 for the colour itself, less for one that light may turn into it.
fn colour_fit(asked: ColourName, seen: ColourName) -> f64 {
    use ColourName::{Black, Blue, Brown, Grey, Orange, Pink, Purple, Red, White, Yellow};
    let near = [
        (Red, Orange),
        (Red, Pink),
        (Orange, Brown),
        (Orange, Yellow),
        (Red, Brown),
        (Purple, Blue),
        (Purple, Pink),
        (Grey, White),
        (Grey, Black),
    ];
    if asked == seen {
        1.0
    } else if near.contains(&(asked, seen)) || near.contains(&(seen, asked)) {
        0.6
    } else {
        0.15
    }
}
