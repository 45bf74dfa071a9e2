//! From the analysed sentence to an answer: act, ask or refuse.

use crate::knowledge::{Knowledge, Thing, Verb};
use crate::reference::{AMBIGUOUS, FLOOR, Fit, Scene};
use crate::sentence::{Attributes, Clause, Head, NounPhrase, Sentence};
use crate::words::{lemmas, tokens};
use sfg_types::grasp_functionality::ObjectRef;
use sfg_types::{FunctionalityAnswer, GraspFunctionality, ObjectCluster, Task};
use std::collections::BTreeSet;

/// Below this the attribute words contradict what is seen.
const CONTRADICTION: f64 = 0.3;

/// Why there is no action.
enum Halt {
    Ask { question: String, choices: Vec<String> },
    Refuse { reason: String },
}

impl From<Halt> for FunctionalityAnswer {
    fn from(halt: Halt) -> Self {
        match halt {
            Halt::Ask { question, choices } => Self::Ask { question, choices },
            Halt::Refuse { reason } => Self::Refuse { reason },
        }
    }
}

/// The answer to `sentence` in `scene`.
pub(crate) fn decide(sentence: &Sentence, scene: &Scene<'_>) -> FunctionalityAnswer {
    let knowledge = scene.knowledge;
    if let Some(reason) = unsafe_reason(sentence, knowledge) {
        return FunctionalityAnswer::Refuse { reason };
    }
    if scene.inventory.clusters.is_empty() {
        return refuse("there is nothing on the table that I could take").into();
    }
    let Some(request) = Request::of(sentence, knowledge) else { return ask_what_to_do(sentence, scene).into() };
    if negated(sentence, knowledge, request.main.at) {
        return refuse("the sentence says what not to do; say what you want instead").into();
    }
    request.act(sentence, scene).map_or_else(FunctionalityAnswer::from, FunctionalityAnswer::Act)
}

fn refuse(reason: &str) -> Halt {
    Halt::Refuse { reason: reason.to_owned() }
}

/// Harm to people or animals is never carried out.
fn unsafe_reason(sentence: &Sentence, knowledge: &Knowledge) -> Option<String> {
    let small = &knowledge.small;
    let is_in = |word: &String, set: &BTreeSet<String>| lemmas(word).iter().any(|form| set.contains(form));
    if let Some(word) = sentence.words.iter().find(|word| is_in(word, &small.harm_always)) {
        return Some(format!("I will not do that: {word:?} could hurt someone"));
    }
    let harms: Vec<usize> = (0..sentence.words.len()).filter(|&i| is_in(&sentence.words[i], &small.harm_people)).collect();
    for at in harms {
        for i in at + 1..sentence.words.len() {
            let word = &sentence.words[i];
            if !small.people.contains(word) {
                continue;
            }
            // "cut me a slice", "pour her some water" serve; "hit him", "pour it on him" do not.
            let next = sentence.words.get(i + 1).map_or("", String::as_str);
            let served = small.determiners.contains(next) || is_noun(sentence, next);
            let before = sentence.words[i - 1].as_str();
            let aimed = ["at", "on", "over", "into", "onto", "against"];
            let before_article = sentence.words[i.saturating_sub(2)].as_str();
            let hits = (i == at + 1 || (i == at + 2 && small.determiners.contains(before))) && !served
                || aimed.contains(&before) && !served
                || small.determiners.contains(before) && aimed.contains(&before_article) && !served;
            if hits {
                return Some(format!("I will not do that: it could hurt {word:?}"));
            }
        }
    }
    None
}

fn is_noun(sentence: &Sentence, word: &str) -> bool {
    !word.is_empty()
        && sentence.nouns.iter().any(|noun| {
            matches!(noun.head, Some(Head::Thing(_) | Head::Seen(_) | Head::Content(_)))
                && noun.said.split(' ').any(|said| said == word)
        })
}

fn negated(sentence: &Sentence, knowledge: &Knowledge, before: usize) -> bool {
    let head = &sentence.words[..before.min(sentence.words.len())];
    knowledge.small.negations.iter().any(|phrase| {
        let phrase = tokens(phrase);
        head.windows(phrase.len()).any(|window| window == phrase)
    })
}

/// A thing is named and no verb, or not even that: ask.
fn ask_what_to_do(sentence: &Sentence, scene: &Scene<'_>) -> Halt {
    let named = sentence.nouns.iter().find_map(|noun| {
        let best = *scene.fits(noun).first()?;
        matches!(noun.head, Some(Head::Thing(_) | Head::Seen(_))).then_some(best)
    });
    if let Some(cluster) = named.and_then(|fit| scene.inventory.cluster(fit.cluster_id)) {
        let what = scene.describe(cluster);
        let choices = vec![format!("pick up {what}"), format!("hand me {what}")];
        return Halt::Ask { question: format!("What shall I do with {what}?"), choices };
    }
    let absent = sentence.nouns.iter().find(|noun| matches!(noun.head, Some(Head::Thing(_))));
    if let Some(noun) = absent {
        return refuse(&format!("I see {}, but no {}", scene.listing(), noun.said));
    }
    let what = scene.describe(&scene.inventory.clusters[0]);
    let choices = vec![format!("pick up {what}"), format!("hand me {what}")];
    Halt::Ask { question: "I did not understand what to do. For example:".to_owned(), choices }
}

/// The roles of a sentence.
struct Request<'a> {
    main: Clause,
    verb: &'a Verb,
    /// The task is that of the verb, or "hand over" for "hand me something to cut with".
    acting: &'a Verb,
    held: Option<&'a NounPhrase>,
    target: Option<&'a NounPhrase>,
    /// A part the user named.
    part: Vec<String>,
    /// Something is held in which the task acts, for example "the soup".
    content: Option<&'a NounPhrase>,
    /// "something to cut with": the tools of the verb are meant.
    by_purpose: bool,
}

/// What is held, with how sure that is.
struct Resolved<'a> {
    cluster: &'a ObjectCluster,
    fit: f64,
    /// What it is taken for, when a tool was looked for.
    thing: Option<&'a Thing>,
    steps: Vec<String>,
}

impl<'a> Request<'a> {
    fn of(sentence: &'a Sentence, knowledge: &'a Knowledge) -> Option<Self> {
        let main_idx = (0..sentence.clauses.len())
            .max_by_key(|&i| (knowledge.verbs[sentence.clauses[i].verb].rank, std::cmp::Reverse(i)))?;
        let main = sentence.clauses[main_idx];
        let verb = &knowledge.verbs[main.verb];
        let thing_like = |noun: &&NounPhrase| !matches!(noun.head, Some(Head::Person | Head::Part(_)));
        let nouns: Vec<&NounPhrase> = sentence.nouns.iter().filter(thing_like).collect();
        let in_role = |clause: usize, role: &str| nouns.iter().copied().find(|n| n.clause == clause && n.role == role);
        let is_tool = |noun: &NounPhrase| match &noun.head {
            Some(Head::Thing(i)) => verb.tools.contains(&knowledge.things[*i].name),
            _ => false,
        };
        let specific = |noun: &NounPhrase| {
            matches!(noun.head, Some(Head::Thing(_) | Head::Seen(_) | Head::Unknown(_))) || !noun.attributes.is_empty()
        };
        let mut held = verb
            .held
            .iter()
            .find_map(|role| nouns.iter().copied().find(|n| n.clause == main_idx && n.role == *role && specific(n)));
        // "grab the handle of the mug".
        let whole_of_part = || {
            let pair =
                sentence.nouns.windows(2).find(|pair| matches!(pair[0].head, Some(Head::Part(_))) && pair[1].role == "of")?;
            (pair[0].clause == main_idx).then_some(&pair[1])
        };
        held = held.or_else(whole_of_part);
        // "stir with it": the sentence before says what.
        let earlier = sentence.nouns.iter().find(|noun| noun.clause != main_idx && noun.role == "direct" && specific(noun));
        let direct_tool = || in_role(main_idx, "direct").filter(|noun| verb.held[..] != ["direct"] && is_tool(noun));
        held = held.or_else(direct_tool).or(earlier);
        let vague = verb.held.iter().filter_map(|role| in_role(main_idx, role)).next();
        held = held.or(vague);
        let same = |a: &NounPhrase, b: Option<&NounPhrase>| b.is_some_and(|b| std::ptr::eq(a, b));
        let target_of = |vague: bool| {
            verb.target.iter().filter_map(|role| in_role(main_idx, role)).find(|noun| {
                !same(noun, held)
                    && (vague || matches!(noun.head, Some(Head::Thing(_) | Head::Seen(_) | Head::Generic(_) | Head::Unknown(_))))
            })
        };
        let content = target_of(true).filter(|noun| matches!(noun.head, Some(Head::Content(_))));
        let mut target = target_of(false);
        // "pour me a cup of water": the cup is for me, the water is poured.
        if let Some((served, poured)) = serving(sentence, main_idx).filter(|_| verb.task == Task::Pour && target.is_none()) {
            (held, target) = (Some(poured), Some(served));
        }
        let part = named_part(sentence, knowledge, held);
        // "hand me something to cut with": the errand is the first verb's, the second says which thing.
        let errand = sentence.clauses[..main_idx]
            .last()
            .map(|clause| &knowledge.verbs[clause.verb])
            .filter(|first| first.rank < verb.rank);
        let vague_errand =
            sentence.nouns.iter().any(|n| n.clause + 1 == main_idx && n.role != "of" && matches!(n.head, Some(Head::Generic(_))));
        let by_purpose = errand.is_some()
            && vague_errand
            && !verb.tools.is_empty()
            && sentence.words[..main.at].iter().any(|w| w == "to" || w == "for");
        let acting = errand.filter(|_| by_purpose).unwrap_or(verb);
        let recipient = verb.task == Task::PickUp
            && sentence.nouns.iter().any(|n| n.role == "to" && n.head == Some(Head::Person) && n.clause == main_idx);
        let acting = if recipient { knowledge.verbs.iter().find(|v| v.task == Task::HandOver).unwrap_or(acting) } else { acting };
        let held = if by_purpose { None } else { held };
        let target = if by_purpose { None } else { target };
        Some(Self { main, verb, acting, held, target, part, content, by_purpose })
    }

    fn act(&self, sentence: &Sentence, scene: &Scene<'_>) -> Result<GraspFunctionality, Halt> {
        let knowledge = scene.knowledge;
        let mut rationale = Vec::new();
        for (written, read) in &sentence.corrections {
            rationale.push(format!("{written:?} is read as {read:?}"));
        }
        rationale.push(format!("{:?} asks for the task {}", self.verb.verb, self.acting.task));
        // The target first, so that what is poured into is not taken for what is poured from.
        let sure_target = self.target.map(|noun| self.resolve(noun, scene, None)).transpose();
        let target = match sure_target {
            Ok(target) => target,
            Err(answer)
                if self.verb.needs_target
                    || self.target.is_some_and(|n| !matches!(n.head, Some(Head::Unknown(_) | Head::Thing(_)))) =>
            {
                return Err(answer);
            }
            // The nail of a hammer need not be on the table.
            Err(_) => None,
        };
        let held = self.held(scene, target.as_ref().map(|t| t.cluster.id))?;
        let (held, asked_part) = held;
        let target = match target {
            None => self.target_by_use(scene, held.cluster.id)?,
            some => some,
        };
        rationale.extend(held.steps.iter().cloned());
        if let Some(target) = &target {
            rationale.extend(target.steps.iter().cloned());
        }
        rationale.extend(self.acting.note.iter().cloned());
        let thing = held.thing.or_else(|| self.category(held.cluster, scene, !asked_part.is_empty()));
        let kind = thing
            .and_then(|thing| knowledge.kind(&thing.kind))
            .or_else(|| knowledge.kind_of_shape(held.cluster.shape))
            .ok_or_else(|| refuse("I do not know how to hold a thing of that form"))?;
        let lid_put_on = self.acting.verb == "put" && kind.name == "lid" && target.is_some();
        let cover = knowledge.verbs.iter().find(|v| v.task == Task::Cover).filter(|_| lid_put_on);
        let acting = cover.unwrap_or(self.acting);
        let parts = if asked_part.is_empty() { &self.part } else { &asked_part };
        let advice = knowledge
            .advice(thing, kind, acting, held.cluster.size_m.y, parts)
            .ok_or_else(|| refuse("I know no safe way to hold it for that"))?;
        let name = thing.map_or_else(
            || held.cluster.names.first().map_or_else(|| "thing".to_owned(), |ranked| ranked.name.clone()),
            |thing| thing.name.clone(),
        );
        rationale.push(format!("{}: {}", advice.part, advice.why));
        rationale.push(format!("grasp type {} for the {} of the {name}", advice.grasp_type, advice.part));
        // The score of an uncertain name weighs a tenth: a wrong guess of the category seldom changes the hold.
        let reference = 0.9 + 0.1 * (held.fit / 0.7).min(1.0);
        let typos = 0.97_f64.powi(i32::try_from(sentence.corrections.len()).unwrap_or(i32::MAX));
        Ok(GraspFunctionality {
            object: ObjectRef { cluster_id: held.cluster.id, name },
            task: acting.task,
            target: target.map(|t| ObjectRef { cluster_id: t.cluster.id, name: self.target_name(t.cluster, scene) }),
            affordance: advice.part,
            grasp_type: advice.grasp_type,
            confidence: advice.confidence * reference * typos,
            rationale,
        })
    }

    /// What is held and, when a lid sits on its pot as one thing, the part of it.
    fn held<'s>(&self, scene: &Scene<'s>, target_id: Option<u32>) -> Result<(Resolved<'s>, Vec<String>), Halt> {
        match self.held {
            Some(noun) if !matches!(noun.head, Some(Head::Content(_))) => {
                let absent_lid = || self.part_instead(noun, scene).map(|(resolved, part)| (resolved, vec![part]));
                match self.resolve(noun, scene, target_id) {
                    Ok(resolved) => Ok((resolved, Vec::new())),
                    Err(answer) => absent_lid().ok_or(answer),
                }
            }
            content => self.by_use(content, scene, target_id).map(|resolved| (resolved, Vec::new())),
        }
    }

    /// "take the lid off the pot" where pot and lid are one cluster: the pot, held at its lid.
    fn part_instead<'s>(&self, noun: &NounPhrase, scene: &Scene<'s>) -> Option<(Resolved<'s>, String)> {
        let Some(Head::Thing(i)) = noun.head else { return None };
        let part = &scene.knowledge.things[i].name;
        let whole = self.target?;
        let resolved = self.resolve(whole, scene, None).ok()?;
        let has_it = scene.best_thing(resolved.cluster).is_some_and(|thing| thing.parts.contains_key(part));
        let mut resolved = resolved;
        resolved.steps.push(format!("the {part} is seen as part of it"));
        has_it.then(|| (resolved, part.clone()))
    }

    /// The cluster a phrase names, or the question or refusal that its absence or ambiguity calls for.
    fn resolve<'s>(&self, noun: &NounPhrase, scene: &Scene<'s>, taken: Option<u32>) -> Result<Resolved<'s>, Halt> {
        if let Some(Head::Unknown(word)) = &noun.head {
            return Err(one_of(&format!("I do not know the word {word:?}. Which one do you mean?"), scene, &[], taken));
        }
        let fits: Vec<Fit> = scene.fits(noun).into_iter().filter(|fit| Some(fit.cluster_id) != taken).collect();
        let Some(best) = fits.first() else {
            return Err(refuse(&format!("I see {}, but no {}", scene.listing(), noun.said)));
        };
        if best.attributes < CONTRADICTION {
            let alike: Vec<u32> = fits.iter().map(|fit| fit.cluster_id).collect();
            return Err(one_of(&format!("I see no {}. Which one do you mean?", noun.said), scene, &alike, taken));
        }
        let rivals: Vec<u32> =
            fits.iter().filter(|fit| fit.total() >= AMBIGUOUS * best.total()).map(|fit| fit.cluster_id).collect();
        if rivals.len() > 1 {
            return Err(one_of(&format!("Which {} do you mean?", noun.said), scene, &rivals, taken));
        }
        let cluster = scene.inventory.cluster(best.cluster_id).ok_or_else(|| refuse("the inventory is inconsistent"))?;
        let step = format!("{:?} is {}, fit {:.2}", noun.said, scene.describe(cluster), best.total());
        Ok(Resolved { cluster, fit: best.total(), thing: None, steps: vec![step] })
    }

    /// No thing is named: the vessel that holds the content, or the tool of the verb.
    fn by_use<'s>(&self, content: Option<&NounPhrase>, scene: &Scene<'s>, taken: Option<u32>) -> Result<Resolved<'s>, Halt> {
        let knowledge = scene.knowledge;
        let (fits, wanted) = if let Some(noun) = content {
            // Anything that pours may hold it; the usual vessels come first.
            let mut fits = scene.fits(noun);
            if fits.iter().all(|fit| Some(fit.cluster_id) == taken) {
                fits = scene.ranked(|cluster| 0.5 * self.pours(cluster, scene), &Attributes::default());
            }
            (fits, format!("a vessel with {}", noun.said))
        } else if self.verb.tools.is_empty() {
            let pours = |cluster: &ObjectCluster| self.pours(cluster, scene);
            let all = |_: &ObjectCluster| 0.6;
            let none = Attributes::default();
            let fits = if self.verb.task == Task::Pour { scene.ranked(pours, &none) } else { scene.ranked(all, &none) };
            (fits, "anything to take".to_owned())
        } else {
            let tools = |cluster: &ObjectCluster| {
                let named = scene.list_score(cluster, &self.verb.tools);
                let first = self.verb.tools.first().and_then(|tool| knowledge.thing(tool));
                named.max(first.map_or(0.0, |thing| 0.7 * scene.thing_score(cluster, thing)))
            };
            (scene.ranked(tools, &Attributes::default()), format!("nothing to {} with", self.verb.verb))
        };
        let fits: Vec<Fit> = fits.into_iter().filter(|fit| Some(fit.cluster_id) != taken).collect();
        let Some(best) = fits.first() else {
            let lack = if wanted.starts_with("nothing") { wanted } else { format!("not {wanted}") };
            return Err(refuse(&format!("I see {}, but {lack}", scene.listing())));
        };
        let rivals: Vec<u32> =
            fits.iter().filter(|fit| fit.total() >= AMBIGUOUS * best.total()).map(|fit| fit.cluster_id).collect();
        if rivals.len() > 1 {
            return Err(one_of(&format!("What shall I {}?", self.question_end()), scene, &rivals, taken));
        }
        let cluster = scene.inventory.cluster(best.cluster_id).ok_or_else(|| refuse("the inventory is inconsistent"))?;
        let step = match content {
            Some(noun) => format!("{:?} is most likely in {}", noun.said, scene.describe(cluster)),
            None => format!("{} serves to {}", scene.describe(cluster), self.verb.verb),
        };
        let thing = if content.is_none() { self.tool_seen_in(cluster, scene) } else { None };
        Ok(Resolved { cluster, fit: best.total(), thing, steps: vec![step] })
    }

    /// The tool of the verb for which the cluster is most likely taken.
    fn tool_seen_in<'k>(&self, cluster: &ObjectCluster, scene: &Scene<'k>) -> Option<&'k Thing> {
        let tools = self.verb.tools.iter().filter_map(|tool| scene.knowledge.thing(tool));
        tools
            .map(|thing| (scene.thing_score(cluster, thing), thing))
            .reduce(|a, b| if b.0 > a.0 { b } else { a })
            .map(|(_, thing)| thing)
    }

    fn question_end(&self) -> String {
        match self.acting.task {
            Task::Pour => "pour from".to_owned(),
            Task::HandOver => "hand over".to_owned(),
            Task::PickUp => "pick up".to_owned(),
            _ => format!("{} with", self.verb.verb),
        }
    }

    /// How readily one pours from a cluster.
    fn pours(&self, cluster: &ObjectCluster, scene: &Scene<'_>) -> f64 {
        let kind = scene.best_thing(cluster).and_then(|thing| scene.knowledge.kind(&thing.kind));
        kind.or_else(|| scene.knowledge.kind_of_shape(cluster.shape)).map_or(0.0, |kind| kind.pours)
    }

    /// No target is named: the one vessel that receives, when the task needs or uses one.
    fn target_by_use<'s>(&self, scene: &Scene<'s>, held: u32) -> Result<Option<Resolved<'s>>, Halt> {
        let wants = self.verb.needs_target || matches!(self.acting.task, Task::StirFry | Task::Whisk);
        if !wants || self.by_purpose {
            return Ok(None);
        }
        let knowledge = scene.knowledge;
        let usual = self.content.or(self.held).and_then(|noun| match noun.head {
            Some(Head::Content(i)) => Some(&knowledge.small.contents[i].vessels),
            _ => None,
        });
        let receives = |cluster: &ObjectCluster| {
            let kind = scene.best_thing(cluster).and_then(|thing| knowledge.kind(&thing.kind));
            let kind = kind.or_else(|| knowledge.kind_of_shape(cluster.shape)).map_or(0.0, |kind| kind.receives);
            kind * usual.map_or(1.0, |vessels| 0.5 + scene.list_score(cluster, vessels))
        };
        let fits: Vec<Fit> =
            scene.ranked(receives, &Attributes::default()).into_iter().filter(|fit| fit.cluster_id != held).collect();
        let Some(best) = fits.first().filter(|fit| fit.total() > FLOOR) else {
            let message = format!("I see {}, but nothing to {} into or onto", scene.listing(), self.verb.verb);
            return if self.verb.needs_target { Err(refuse(&message)) } else { Ok(None) };
        };
        let rivals: Vec<u32> = fits.iter().filter(|fit| fit.total() >= 0.75 * best.total()).map(|fit| fit.cluster_id).collect();
        if rivals.len() > 1 {
            if !self.verb.needs_target {
                return Ok(None);
            }
            let preposition = if self.acting.task == Task::Cover { "cover" } else { "pour into" };
            return Err(one_of(&format!("What shall I {preposition}?"), scene, &rivals, Some(held)));
        }
        let Some(cluster) = scene.inventory.cluster(best.cluster_id) else { return Ok(None) };
        let steps = vec![format!("no target is named; {} is the only fitting one", scene.describe(cluster))];
        Ok(Some(Resolved { cluster, fit: best.total(), thing: None, steps }))
    }

    /// The category under which the held cluster is treated: the word of the user before the guess of the cameras.
    fn category<'k>(&self, cluster: &ObjectCluster, scene: &Scene<'k>, part_of_whole: bool) -> Option<&'k Thing> {
        let named = match self.held.and_then(|noun| noun.head.as_ref()) {
            Some(Head::Thing(i)) if !part_of_whole => Some(&scene.knowledge.things[*i]),
            Some(Head::Seen(_)) => return None,
            _ => None,
        };
        named.or_else(|| scene.best_thing(cluster))
    }

    fn target_name(&self, cluster: &ObjectCluster, scene: &Scene<'_>) -> String {
        match self.target.and_then(|noun| noun.head.as_ref()) {
            Some(Head::Thing(i)) => scene.knowledge.things[*i].name.clone(),
            _ => cluster.names.first().map_or_else(|| "thing".to_owned(), |ranked| ranked.name.clone()),
        }
    }
}

/// "me a cup of water": the cup and the water.
fn serving(sentence: &Sentence, clause: usize) -> Option<(&NounPhrase, &NounPhrase)> {
    sentence.nouns.windows(3).find_map(|three| {
        let [person, vessel, content] = three else { return None };
        let fits = person.head == Some(Head::Person)
            && matches!(vessel.head, Some(Head::Thing(_) | Head::Seen(_)))
            && content.role == "of"
            && matches!(content.head, Some(Head::Content(_)))
            && three.iter().all(|noun| noun.clause == clause);
        fits.then_some((vessel, content))
    })
}

/// The part names that the user asked for: "by the handle", "the handle of the mug".
fn named_part(sentence: &Sentence, knowledge: &Knowledge, held: Option<&NounPhrase>) -> Vec<String> {
    let parts = |noun: &NounPhrase| match noun.head {
        Some(Head::Part(i)) => Some(knowledge.small.parts[i].parts.clone()),
        _ => None,
    };
    let by = sentence.nouns.iter().find(|noun| ["by", "at", "on"].contains(&noun.role.as_str()) && parts(noun).is_some());
    let of = sentence
        .nouns
        .windows(2)
        .find(|pair| parts(&pair[0]).is_some() && pair[1].role == "of" && held.is_none_or(|held| held.clause == pair[0].clause));
    by.or_else(|| of.map(|pair| &pair[0])).and_then(parts).unwrap_or_default()
}

/// A question whose choices are the clusters `ids` (empty = all), at least two.
fn one_of(question: &str, scene: &Scene<'_>, ids: &[u32], taken: Option<u32>) -> Halt {
    let mut choices: Vec<String> = scene
        .inventory
        .clusters
        .iter()
        .filter(|cluster| Some(cluster.id) != taken && (ids.is_empty() || ids.contains(&cluster.id)))
        .map(|cluster| scene.describe(cluster))
        .collect();
    if choices.len() < 2 {
        choices.push("none of these".to_owned());
    }
    if choices.len() < 2 {
        return refuse(&format!("{question} I see {}", scene.listing()));
    }
    Halt::Ask { question: question.to_owned(), choices }
}
