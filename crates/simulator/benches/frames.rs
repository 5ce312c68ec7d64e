//! Frames per second of the simulator.

use stillpoint_simulator::{Simulator, SimulatorConfig, scene_names};

fn main() {
    divan::main();
}

fn simulator(scene: &str) -> Simulator {
    let config = SimulatorConfig {
        scene: scene.to_owned(),
        ..SimulatorConfig::default()
    };
    Simulator::new(&config).expect("a known scene")
}

#[divan::bench(args = scene_names(), sample_count = 20)]
fn frame(bencher: divan::Bencher, scene: &str) {
    let sim = simulator(scene);
    let mut index = 0;
    bencher
        .counter(divan::counter::ItemsCount::new(1_usize))
        .bench_local(|| {
            index += 7;
            sim.frame(index)
        });
}

#[divan::bench(args = scene_names(), sample_count = 20)]
fn depth(bencher: divan::Bencher, scene: &str) {
    let sim = simulator(scene);
    let mut index = 0;
    bencher
        .counter(divan::counter::ItemsCount::new(1_usize))
        .bench_local(|| {
            index += 7;
            sim.depth(index)
        });
}

#[divan::bench(sample_count = 5)]
fn build(bencher: divan::Bencher) {
    bencher.bench_local(|| simulator("loop_two_rooms"));
}
