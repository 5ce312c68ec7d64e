//! Starts a run with the rolling shutter readout that a map stores.

use stillpoint::slam::{Config, SensorConfig};

/// Minimum standard deviation of a readout taken from a map, s.
const LEAST_SIGMA: f64 = 0.001;

/// Sets the readout from the map, unless the user changed one of its settings.
pub(crate) fn start_with(config: &mut Config, known: Option<[f64; 2]>) {
    let (own, usual) = (&mut config.sensor, SensorConfig::default());
    let untouched = own.readout == usual.readout && own.readout_sigma == usual.readout_sigma;
    if let Some([readout, sigma]) = known.filter(|_| own.self_calibrate && untouched) {
        // Less certain than the map: the camera's frame rate may have been changed since.
        (own.readout, own.readout_sigma) = (readout, sigma.max(LEAST_SIGMA));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn map_readout_is_used_unless_configured() {
        let started = |change: &dyn Fn(&mut SensorConfig), known| {
            let mut config = Config::default();
            change(&mut config.sensor);
            start_with(&mut config, known);
            [config.sensor.readout, config.sensor.readout_sigma]
        };
        let known = Some([0.02, 0.002]);
        assert_eq!(started(&|_| (), known), [0.02, 0.002]);
        assert_eq!(started(&|_| (), Some([0.02, 0.0])), [0.02, LEAST_SIGMA]);
        let usual = SensorConfig::default();
        let untouched = [usual.readout, usual.readout_sigma];
        assert_eq!(started(&|_| (), None), untouched);
        assert_eq!(started(&|s| s.self_calibrate = false, known), untouched);
        assert_eq!(started(&|s| s.readout = 0.01, known), [0.01, 0.02]);
    }
}
