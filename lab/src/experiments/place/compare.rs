//! Ways of recognising places, compared on real and simulated recordings of which the overlap of all views is known.
//!
//! Run: `cargo run --release -p stillpoint-place --example compare [VOCABULARY ...]`. Prints a Markdown table; further vocabularies get rows of their own. Some
//! minutes: it renders more than 2000 images.
//! Real recordings are looked for in the folder of the environment variable STILLPOINT_DATA, else in ../shared/data.
// A program that prints, reads files and takes times.
#![allow(
    clippy::print_stdout,
    clippy::disallowed_methods,
    clippy::disallowed_types
)]

#[path = "../common/mod.rs"]
mod common;
mod hamming_tree;
mod judge;
mod method;
mod random_words;

use common::world::{Simulated, recorded, simulated};
use hamming_tree::HammingTree;
use judge::{Figures, Trial};
use method::{BruteForce, Method, Words};
use random_words::RandomWords;
use std::error::Error;
use std::time::Instant;
use stillpoint_place::Vocabulary;

/// Seeds of the rooms; the vocabulary is trained on others.
const SEEDS: [u64; 4] = [0, 1, 2, 3];
/// The real recording, small enough for the yardstick.
const KITCHEN: &str = "kitchen";

fn main() -> Result<(), Box<dyn Error>> {
    let trials = trials()?;
    for (name, trials) in &trials {
        let sum = |f: fn(&Trial) -> usize| trials.iter().map(f).sum::<usize>();
        println!(
            "{name}: {} keyframes, {} of them revisits, {} elsewhere",
            sum(|t| t.keyframes.len()),
            sum(Trial::revisits),
            sum(|t| t.elsewhere.len())
        );
    }
    let names: Vec<&str> = trials.iter().map(|(name, _)| name.as_str()).collect();
    let names = names.join(" | ");
    println!("\n| method | {names} | insert ms | query ms | kB per keyframe |");
    println!("|---|{}---:|---:|---:|", "---|".repeat(trials.len()));
    if trials.iter().any(|(name, _)| name == KITCHEN) {
        report(&mut BruteForce::default(), &trials, true);
    }
    for mut method in methods()? {
        report(&mut *method, &trials, false);
    }
    Ok(())
}

fn methods() -> Result<Vec<Box<dyn Method>>, Box<dyn Error>> {
    let words = |name: &str, vocabulary: Vocabulary, features| -> Box<dyn Method> {
        Box::new(Words::new(name, vocabulary, features))
    };
    let mut methods = vec![
        words("vocabulary, words", Vocabulary::embedded(), false),
        words("vocabulary, features", Vocabulary::embedded(), true),
    ];
    for file in std::env::args().skip(1) {
        let vocabulary = Vocabulary::from_bytes(&std::fs::read(&file)?)?;
        methods.push(words(&format!("{file}, words"), vocabulary.clone(), false));
        methods.push(words(&format!("{file}, features"), vocabulary, true));
    }
    methods.push(Box::new(HammingTree::new(25)));
    methods.push(Box::new(HammingTree::new(40)));
    methods.push(Box::new(RandomWords::new(1, 12)));
    methods.push(Box::new(RandomWords::new(4, 14)));
    Ok(methods)
}

type Trials = Vec<(String, Vec<Trial>)>;

fn trials() -> Result<Trials, Box<dyn Error>> {
    let mut trials = Vec::new();
    let kitchen = common::data_folder().join(KITCHEN);
    if kitchen.is_dir() {
        trials.push((
            KITCHEN.to_owned(),
            vec![Trial::new(recorded(&kitchen, None)?, Vec::new())],
        ));
    } else {
        println!("skipped: {} is not there", kitchen.display());
    }
    let scene = |scene, seed, frames| {
        simulated(&Simulated {
            scene,
            seed,
            frames,
        })
    };
    let mut two_rooms = Vec::new();
    let mut people = Vec::new();
    for seed in SEEDS {
        // The office of a seed has the posters, chairs and floors of its two rooms, at other places.
        let mut office = Vec::new();
        for name in ["halfsphere", "rpy", "xyz"] {
            office.extend(scene(name, seed, None)?);
        }
        two_rooms.push(Trial::new(scene("loop_two_rooms", seed, None)?, office));
        for name in ["walking_xyz", "walking_rpy", "walking_halfsphere"] {
            people.push(Trial::new(scene(name, seed, Some(600))?, Vec::new()));
        }
    }
    trials.push(("two rooms".to_owned(), two_rooms));
    trials.push(("people".to_owned(), people));
    Ok(trials)
}

/// Prints a row of the table; of a yardstick the first trial alone, because it takes its time.
fn report(method: &mut dyn Method, trials: &Trials, yardstick: bool) {
    print!("| {} |", method.name());
    let shown = if yardstick { 1 } else { trials.len() };
    for (_, trials) in &trials[..shown] {
        let mut figures = Figures::default();
        for trial in trials {
            figures.add(method, trial);
        }
        let r = figures.row();
        let [raw, relative, first, ten] =
            [r.safe[0], r.safe[1], r.first, r.ten].map(|share| 100.0 * share);
        print!(" {raw:.0} / {relative:.0} / {first:.0} / {ten:.0} |");
    }
    if yardstick {
        println!("{}", " - |".repeat(trials.len() - shown + 3));
        return;
    }
    let (insert, query, kilobytes) = at_1000(method, trials);
    println!(" {insert:.2} | {query:.2} | {kilobytes:.0} |");
}

/// Median times of an insertion and of a query at 1000 keyframes, ms, and kB per keyframe.
fn at_1000(method: &mut dyn Method, trials: &Trials) -> (f64, f64, f64) {
    let all = trials
        .iter()
        .flat_map(|(_, t)| t)
        .flat_map(|t| t.keyframes.iter().chain(&t.elsewhere));
    let images: Vec<_> = all.map(|k| &k.descriptors).cycle().take(1000).collect();
    method.clear();
    let timed = |work: &mut dyn FnMut()| {
        let start = Instant::now();
        work();
        start.elapsed().as_secs_f64() * 1e3
    };
    let median = |mut times: Vec<f64>| {
        times.sort_by(f64::total_cmp);
        times[times.len() / 2]
    };
    let mut inserts = Vec::new();
    for (key, image) in images.iter().enumerate() {
        inserts.push(timed(&mut || method.insert(key, image)));
    }
    let mut queries = Vec::new();
    for image in images.iter().step_by(50) {
        queries.push(timed(&mut || drop(method.query(image, &|_| true, 10))));
    }
    (
        median(inserts),
        median(queries),
        method.bytes() as f64 / 1e6,
    )
}
