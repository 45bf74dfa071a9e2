//! A small deterministic grammar: a sentence becomes clauses (verb) with noun phrases in their roles.

use crate::knowledge::Knowledge;
use crate::words::{corrected, lemmas, tokens};
use sfg_types::ColourName;
use std::collections::{BTreeMap, BTreeSet};

/// Most words that "..." of a pattern stands for.
const MAX_GAP: usize = 6;

/// What the noun of a phrase is.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Head {
    /// A known thing, by index.
    Thing(usize),
    /// A name of the inventory that the knowledge lacks.
    Seen(String),
    /// What vessels hold, by index.
    Content(usize),
    /// Part of a thing, by index.
    Part(usize),
    /// "it", "the one", "container", by index.
    Generic(usize),
    /// A person.
    Person,
    /// A word nobody taught us.
    Unknown(String),
}

/// Words that narrow the choice down.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Attributes {
    pub(crate) colours: Vec<ColourName>,
    /// Indices into the size words.
    pub(crate) sizes: Vec<usize>,
    /// Indices into the place words.
    pub(crate) places: Vec<usize>,
}

impl Attributes {
    pub(crate) fn is_empty(&self) -> bool {
        self.colours.is_empty() && self.sizes.is_empty() && self.places.is_empty()
    }
}

/// A noun with what stands before and after it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct NounPhrase {
    /// Index of the clause it belongs to; nouns before the first verb belong to clause 0.
    pub(crate) clause: usize,
    /// `direct` or the preposition.
    pub(crate) role: String,
    pub(crate) head: Option<Head>,
    pub(crate) attributes: Attributes,
    /// As it was said, for questions and refusals.
    pub(crate) said: String,
}

/// A verb as it stands in the sentence.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Clause {
    /// Index into the verbs.
    pub(crate) verb: usize,
    /// Position of its first word.
    pub(crate) at: usize,
}

/// A sentence, analysed.
#[derive(Clone, Debug, Default)]
pub(crate) struct Sentence {
    pub(crate) words: Vec<String>,
    pub(crate) clauses: Vec<Clause>,
    pub(crate) nouns: Vec<NounPhrase>,
    /// Typing errors: as written, as read.
    pub(crate) corrections: Vec<(String, String)>,
}

/// Index of phrases over the knowledge, built once.
#[derive(Clone, Debug)]
pub(crate) struct Lexicon {
    nouns: BTreeMap<Vec<String>, Head>,
    colours: BTreeMap<String, ColourName>,
    sizes: BTreeMap<String, usize>,
    places: Vec<(Vec<String>, usize)>,
    prepositions: Vec<Vec<String>>,
    /// Verb index, words of the pattern; `None` = a gap.
    patterns: Vec<(usize, Vec<Option<String>>)>,
    determiners: BTreeSet<String>,
    known: BTreeSet<String>,
}

impl Lexicon {
    pub(crate) fn new(knowledge: &Knowledge) -> Self {
        let small = &knowledge.small;
        let mut nouns = BTreeMap::new();
        // Later entries win, so that a thing is preferred to a content, and a content to a part.
        for (i, generic) in small.generic.iter().enumerate() {
            nouns.extend(generic.words.iter().map(|word| (tokens(word), Head::Generic(i))));
        }
        nouns.extend(small.people.iter().map(|word| (tokens(word), Head::Person)));
        for (i, part) in small.parts.iter().enumerate() {
            nouns.extend(part.words.iter().map(|word| (tokens(word), Head::Part(i))));
        }
        for (i, contents) in small.contents.iter().enumerate() {
            nouns.extend(contents.words.iter().map(|word| (tokens(word), Head::Content(i))));
        }
        for (i, thing) in knowledge.things.iter().enumerate() {
            nouns.extend(thing.words.iter().chain([&thing.name]).map(|word| (tokens(word), Head::Thing(i))));
        }
        let mut colours = BTreeMap::new();
        for (name, words) in &small.colours {
            if let Some(colour) = colour_named(name) {
                colours.extend(words.iter().map(|word| (word.clone(), colour)));
            }
        }
        let sizes =
            small.sizes.iter().enumerate().flat_map(|(i, size)| size.words.iter().map(move |word| (word.clone(), i))).collect();
        let longest_first = |phrases: &mut Vec<Vec<String>>| phrases.sort_by_key(|phrase| std::cmp::Reverse(phrase.len()));
        let mut prepositions: Vec<_> = small.prepositions.iter().map(|phrase| tokens(phrase)).collect();
        longest_first(&mut prepositions);
        let mut places: Vec<_> =
            small.places.iter().enumerate().flat_map(|(i, p)| p.phrases.iter().map(move |phrase| (tokens(phrase), i))).collect();
        places.sort_by_key(|(phrase, _)| std::cmp::Reverse(phrase.len()));
        let pattern = |phrase: &str| -> Vec<Option<String>> {
            let parts: Vec<Vec<String>> = phrase.split("...").map(tokens).collect();
            parts.into_iter().map(|part| part.into_iter().map(Some).collect::<Vec<_>>()).collect::<Vec<_>>().join(&None)
        };
        let patterns =
            knowledge.verbs.iter().enumerate().flat_map(|(i, v)| v.phrases.iter().map(move |p| (i, pattern(p)))).collect();
        let mut lexicon = Self {
            nouns,
            colours,
            sizes,
            places,
            prepositions,
            patterns,
            determiners: small.determiners.clone(),
            known: BTreeSet::new(),
        };
        lexicon.known = lexicon.all_words(knowledge);
        lexicon
    }

    fn behind_article(&self, words: &[String]) -> bool {
        words.last().is_some_and(|word| self.determiners.contains(word))
    }

    fn all_words(&self, knowledge: &Knowledge) -> BTreeSet<String> {
        let small = &knowledge.small;
        let mut known: BTreeSet<String> = self.nouns.keys().flatten().cloned().collect();
        known.extend(self.colours.keys().cloned());
        known.extend(self.sizes.keys().cloned());
        known.extend(self.places.iter().flat_map(|(phrase, _)| phrase.iter().cloned()));
        known.extend(self.prepositions.iter().flatten().cloned());
        known.extend(self.patterns.iter().flat_map(|(_, pattern)| pattern.iter().flatten().cloned()));
        known.extend(small.negations.iter().flat_map(|phrase| tokens(phrase)));
        for set in [&small.determiners, &small.fillers, &small.harm_always, &small.harm_people] {
            known.extend(set.iter().flat_map(|word| tokens(word)));
        }
        known
    }

    /// The analysis of `text`; `seen` are the names of the inventory.
    pub(crate) fn parse(&self, text: &str, seen: &BTreeSet<String>) -> Sentence {
        let mut sentence = Sentence::default();
        let seen: BTreeMap<Vec<String>, &String> = seen.iter().map(|name| (tokens(name), name)).collect();
        let mut known = self.known.clone();
        known.extend(seen.keys().flatten().cloned());
        // Behind an article stands a noun: "the stapler" is no misspelt "staple".
        let mut nominal: BTreeSet<String> = self.nouns.keys().flatten().chain(seen.keys().flatten()).cloned().collect();
        nominal.extend(self.colours.keys().chain(self.sizes.keys()).cloned());
        for word in tokens(text) {
            if lemmas(&word).iter().any(|form| known.contains(form)) {
                sentence.words.push(word);
            } else if let Some(right) = corrected(&word, if self.behind_article(&sentence.words) { &nominal } else { &known }) {
                sentence.corrections.push((word, right.to_owned()));
                sentence.words.push(right.to_owned());
            } else {
                sentence.words.push(word);
            }
        }
        let reader = Reader { lexicon: self, seen: &seen, known: &known, words: &sentence.words };
        let (clauses, consumed) = reader.clauses();
        sentence.nouns = reader.nouns(&clauses, &consumed);
        sentence.clauses = clauses;
        sentence
    }
}

/// One pass over one sentence.
struct Reader<'a> {
    lexicon: &'a Lexicon,
    seen: &'a BTreeMap<Vec<String>, &'a String>,
    known: &'a BTreeSet<String>,
    words: &'a [String],
}

impl Reader<'_> {
    /// The longest noun at `at`: its meaning and number of words. Only the last word may be inflected.
    fn noun(&self, at: usize) -> Option<(Head, usize)> {
        let longest = 4.min(self.words.len() - at);
        (1..=longest).rev().find_map(|n| {
            let (last, rest) = self.words[at..at + n].split_last()?;
            lemmas(last).into_iter().find_map(|form| {
                let mut phrase = rest.to_vec();
                phrase.push(form);
                let known = self.lexicon.nouns.get(&phrase).cloned();
                known.or_else(|| self.seen.get(&phrase).map(|name| Head::Seen((*name).clone()))).map(|head| (head, n))
            })
        })
    }

    /// The preposition at `at` and its number of words.
    fn preposition(&self, at: usize) -> Option<(String, usize)> {
        let phrase = self.lexicon.prepositions.iter().find(|phrase| self.words[at..].starts_with(phrase))?;
        Some((phrase.join(" "), phrase.len()))
    }

    fn place(&self, at: usize) -> Option<(usize, usize)> {
        self.lexicon.places.iter().find(|(phrase, _)| self.words[at..].starts_with(phrase)).map(|(phrase, i)| (*i, phrase.len()))
    }

    fn is_adjective(&self, word: &str) -> bool {
        self.lexicon.colours.contains_key(word) || self.lexicon.sizes.contains_key(word)
    }

    /// Words that are both noun and verb are nouns behind an article, an adjective or a preposition.
    fn in_noun_position(&self, at: usize) -> bool {
        let Some(before) = at.checked_sub(1).map(|i| self.words[i].as_str()) else { return false };
        let behind_preposition =
            ["with", "using", "of", "from", "into", "onto", "on", "in", "by", "over", "off"].contains(&before);
        self.lexicon.determiners.contains(before) || self.is_adjective(before) || behind_preposition
    }

    /// Position after the pattern and the word positions it uses up, when it matches at `at`.
    fn matches(&self, pattern: &[Option<String>], at: usize) -> Option<(usize, Vec<usize>)> {
        let (mut position, mut used, mut contiguous, mut gap) = (at, Vec::new(), true, 0);
        for (i, element) in pattern.iter().enumerate() {
            let Some(word) = element else {
                (contiguous, gap) = (false, MAX_GAP);
                continue;
            };
            let hit = (position..self.words.len().min(position + gap + 1))
                .find(|&p| if i == 0 { lemmas(&self.words[p]).contains(word) } else { &self.words[p] == word })?;
            if contiguous {
                used.push(hit);
            }
            (position, gap) = (hit + 1, 0);
        }
        Some((position, used))
    }

    /// All verbs, and the words they use up.
    fn clauses(&self) -> (Vec<Clause>, BTreeSet<usize>) {
        let mut clauses = Vec::new();
        let mut consumed = BTreeSet::new();
        let mut at = 0;
        while at < self.words.len() {
            let noun = self.noun(at);
            // "the spray bottle", "with the drill": nouns. "spray the mirror": a verb.
            if let Some((_, n)) = &noun {
                if *n > 1 || self.in_noun_position(at) {
                    at += n;
                    continue;
                }
            } else if self.in_noun_position(at) && at + 1 < self.words.len() && self.noun(at + 1).is_some() {
                // "the open bottle": an adjective.
                at += 1;
                continue;
            }
            if at.checked_sub(1).is_some_and(|i| self.lexicon.determiners.contains(&self.words[i])) {
                at += 1;
                continue;
            }
            let best = self
                .lexicon
                .patterns
                .iter()
                .filter_map(|(verb, pattern)| self.matches(pattern, at).map(|(_, used)| (verb, pattern, used)))
                .max_by_key(|(verb, pattern, used)| (pattern.iter().flatten().count(), used.len(), std::cmp::Reverse(**verb)));
            if let Some((verb, _, used)) = best {
                clauses.push(Clause { verb: *verb, at });
                at = used.last().map_or(at + 1, |last| last + 1);
                consumed.extend(used);
            } else {
                at += 1;
            }
        }
        (clauses, consumed)
    }

    fn nouns(&self, clauses: &[Clause], consumed: &BTreeSet<usize>) -> Vec<NounPhrase> {
        let mut nouns = Vec::new();
        let mut open = Open::default();
        let mut at = 0;
        while at < self.words.len() {
            let word = &self.words[at];
            if consumed.contains(&at) {
                open.close(&mut nouns);
                open.clause = clauses.iter().rposition(|clause| clause.at <= at).unwrap_or(0);
                open.role = "direct".to_owned();
                at += 1;
                continue;
            }
            if let Some((i, n)) = self.place(at) {
                open.attributes.places.push(i);
                open.say(&self.words[at..at + n]);
                at += n;
                continue;
            }
            if let Some((preposition, n)) = self.preposition(at) {
                open.close(&mut nouns);
                open.role = match preposition.as_str() {
                    "on top of" => "on".to_owned(),
                    "inside" => "in".to_owned(),
                    "and" | "then" | "so" => "direct".to_owned(),
                    _ => preposition,
                };
                at += n;
                continue;
            }
            if let Some(&colour) = self.lexicon.colours.get(word).filter(|_| !self.is_fruit(at)) {
                open.attributes.colours.push(colour);
                open.say(&self.words[at..=at]);
                at += 1;
            } else if let Some(&size) = self.lexicon.sizes.get(word) {
                open.attributes.sizes.push(size);
                open.say(&self.words[at..=at]);
                at += 1;
            } else if let Some((head, n)) = self.noun(at).filter(|(head, n)| !self.is_modal(at, head, *n)) {
                if self.lexicon.determiners.contains(word) && matches!(head, Head::Generic(_)) && self.begins_noun(at + 1) {
                    // "this mug": an article, no noun of its own.
                    open.close(&mut nouns);
                } else {
                    open.noun(head, &self.words[at..at + n], &mut nouns);
                }
                at += n;
            } else {
                if self.lexicon.determiners.contains(word) && open.head.is_some() {
                    open.close(&mut nouns);
                } else if !lemmas(word).iter().any(|form| self.known.contains(form)) && word.chars().any(char::is_alphabetic) {
                    open.noun(Head::Unknown(word.clone()), &self.words[at..=at], &mut nouns);
                }
                at += 1;
            }
        }
        open.close(&mut nouns);
        nouns
    }

    fn begins_noun(&self, at: usize) -> bool {
        at < self.words.len() && (self.is_adjective(&self.words[at]) || self.noun(at).is_some())
    }

    /// "can you": no can.
    fn is_modal(&self, at: usize, head: &Head, n: usize) -> bool {
        let next = self.words.get(at + 1).map_or("", String::as_str);
        n == 1 && matches!(head, Head::Thing(_)) && self.words[at] == "can" && ["you", "i", "we", "u"].contains(&next)
    }

    /// "the orange": a fruit unless a noun follows.
    fn is_fruit(&self, at: usize) -> bool {
        self.words[at] == "orange" && !self.begins_noun(at + 1)
    }
}

/// The noun phrase being read.
#[derive(Debug)]
struct Open {
    clause: usize,
    role: String,
    head: Option<Head>,
    attributes: Attributes,
    said: Vec<String>,
}

impl Default for Open {
    fn default() -> Self {
        Self { clause: 0, role: "direct".to_owned(), head: None, attributes: Attributes::default(), said: Vec::new() }
    }
}

impl Open {
    fn say(&mut self, words: &[String]) {
        self.said.extend_from_slice(words);
    }

    /// Adds a noun: a second one refines ("milk bottle") or, behind a person ("me the mug"), begins anew.
    fn noun(&mut self, head: Head, words: &[String], nouns: &mut Vec<NounPhrase>) {
        match (&self.head, &head) {
            (Some(Head::Person), _) => self.close(nouns),
            // "pen cap": the pen, to be held at its cap.
            (Some(Head::Thing(_) | Head::Seen(_)), Head::Part(_)) => {
                let said = words.join(" ");
                let attributes = Attributes::default();
                nouns.push(NounPhrase { clause: self.clause, role: "by".to_owned(), head: Some(head), attributes, said });
                return;
            }
            // "bottle thing": the first says more.
            (Some(Head::Thing(_) | Head::Seen(_)), Head::Generic(_) | Head::Unknown(_) | Head::Content(_)) => {
                self.say(words);
                return;
            }
            _ => {}
        }
        self.say(words);
        self.head = Some(head);
    }

    fn close(&mut self, nouns: &mut Vec<NounPhrase>) {
        let attributes = std::mem::take(&mut self.attributes);
        let said = std::mem::take(&mut self.said).join(" ");
        let head = self.head.take();
        if head.is_some() || !attributes.is_empty() {
            nouns.push(NounPhrase { clause: self.clause, role: self.role.clone(), head, attributes, said });
        }
    }
}

fn colour_named(name: &str) -> Option<ColourName> {
    use ColourName::{Black, Blue, Brown, Green, Grey, Orange, Pink, Purple, Red, White, Yellow};
    [Black, Grey, White, Red, Orange, Yellow, Green, Blue, Purple, Pink, Brown]
        .into_iter()
        .find(|colour| crate::words::colour_word(*colour) == name)
}
