//! Comparison of place recognition methods on recordings with known overlap of all views.
//!
//! A row per method; vocabularies in the arguments get further rows. Takes some minutes, to render more than 2000 images.

use super::hamming_tree::HammingTree;
use super::judge::{Figures, Trial};
use super::keyframes::{Keyframe, Simulated, recorded, simulated};
use super::method::{BruteForce, Method, Words};
use super::random_words::RandomWords;
use crate::Failure;
use crate::experiments::shared::each_seed;
use crate::inputs::data_folder;
use crate::table::{self, ABSENT, Table, figure, spread};
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Instant;
use stillpoint::place::Vocabulary;

/// The real recording, small enough for the reference method.
const KITCHEN: &str = "kitchen";

/// Compares place recognition methods, with known overlap of all views
#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Rooms, of seeds from 0 on; the vocabulary is trained on others
    #[arg(long, default_value_t = 4)]
    seeds: u64,
    /// Maximum number of frames per scene
    #[arg(long)]
    frames: Option<usize>,
    /// Further vocabularies
    vocabularies: Vec<PathBuf>,
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    println!("{} seeds", arguments.seeds);
    let trials = trials(arguments)?;
    for (name, trials) in &trials {
        let sum = |f: fn(&Trial) -> usize| trials.iter().map(f).sum::<usize>();
        println!(
            "{name}: {} keyframes, {} of them revisits, {} elsewhere",
            sum(|t| t.keyframes.len()),
            sum(Trial::revisits),
            sum(|t| t.elsewhere.len())
        );
    }
    let names = trials.iter().map(|(name, _)| name.as_str());
    let times = ["insert ms", "query ms", "kB per keyframe"];
    let mut table = Table::new(["method"].into_iter().chain(names).chain(times));
    if trials.iter().any(|(name, _)| name == KITCHEN) {
        report(&mut table, &mut BruteForce::default(), &trials, true);
    }
    for mut method in methods(&arguments.vocabularies)? {
        report(&mut table, &mut *method, &trials, false);
    }
    println!();
    table::print(&table);
    Ok(ExitCode::SUCCESS)
}

fn methods(files: &[PathBuf]) -> Result<Vec<Box<dyn Method>>, Failure> {
    let words = |name: &str, vocabulary: Vocabulary, features| -> Box<dyn Method> {
        Box::new(Words::new(name, vocabulary, features))
    };
    let mut methods = vec![
        words("vocabulary, words", Vocabulary::embedded(), false),
        words("vocabulary, features", Vocabulary::embedded(), true),
    ];
    for file in files {
        let vocabulary = Vocabulary::from_bytes(&std::fs::read(file)?)?;
        let file = file.display();
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

fn trials(arguments: &Arguments) -> Result<Trials, Failure> {
    let mut trials = Vec::new();
    let kitchen = data_folder().join(KITCHEN);
    if kitchen.is_dir() {
        let trial = Trial::new(recorded(&kitchen, None)?, Vec::new());
        trials.push((KITCHEN.to_owned(), vec![trial]));
    } else {
        println!("skipped: {} is not there", kitchen.display());
    }
    let of_seed = |seed| -> Result<(Trial, Vec<Trial>), Failure> {
        let all = |scenes: [&'static str; 3], frames: Option<usize>| {
            let frames = arguments.frames.or(frames);
            let scene = |scene| {
                simulated(&Simulated {
                    scene,
                    seed,
                    frames,
                })
            };
            scenes.into_iter().map(scene).collect()
        };
        let walk = simulated(&Simulated {
            scene: "loop_two_rooms",
            seed,
            frames: arguments.frames,
        })?;
        // The office has the same posters, chairs and floors, at other places.
        let office: Result<Vec<Vec<Keyframe>>, Failure> = all(["halfsphere", "rpy", "xyz"], None);
        let people = ["walking_xyz", "walking_rpy", "walking_halfsphere"];
        let people: Result<Vec<Vec<Keyframe>>, Failure> = all(people, Some(600));
        let people = people?.into_iter().map(|k| Trial::new(k, Vec::new()));
        Ok((
            Trial::new(walk, office?.into_iter().flatten().collect()),
            people.collect(),
        ))
    };
    let (two_rooms, people): (Vec<_>, Vec<_>) =
        each_seed(arguments.seeds, of_seed)?.into_iter().unzip();
    trials.push(("two rooms".to_owned(), two_rooms));
    trials.push(("people".to_owned(), people.into_iter().flatten().collect()));
    Ok(trials)
}

/// Adds a row; of the slow reference method only the first trial.
fn report(table: &mut Table, method: &mut dyn Method, trials: &Trials, yardstick: bool) {
    let mut row = vec![method.name()];
    let shown = if yardstick { 1 } else { trials.len() };
    for (_, trials) in &trials[..shown] {
        let mut figures = Figures::default();
        for trial in trials {
            figures.add(method, trial);
        }
        let r = figures.row();
        let [raw, relative, first, ten] =
            [r.safe[0], r.safe[1], r.first, r.ten].map(|share| 100.0 * share);
        row.push(format!("{raw:.0} / {relative:.0} / {first:.0} / {ten:.0}"));
    }
    if yardstick {
        row.resize(trials.len() + 4, ABSENT.to_owned());
    } else {
        let (insert, query, kilobytes) = at_1000(method, trials);
        row.extend([figure(insert, 2), figure(query, 2), figure(kilobytes, 0)]);
    }
    table.row(row);
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
    let mut inserts = Vec::new();
    for (key, image) in images.iter().enumerate() {
        inserts.push(timed(&mut || method.insert(key, image)));
    }
    let mut queries = Vec::new();
    for image in images.iter().step_by(50) {
        queries.push(timed(&mut || drop(method.query(image, &|_| true, 10))));
    }
    (
        spread(inserts)[0],
        spread(queries)[0],
        method.bytes() as f64 / 1e6,
    )
}
