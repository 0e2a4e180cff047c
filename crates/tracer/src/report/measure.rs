//! Times that can be compared: CPU time, medians of several runs.

use cpu_time::ProcessTime;

/// CPU seconds of several runs, all threads together.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cost {
    pub(crate) median: f64,
    pub(crate) least: f64,
    pub(crate) most: f64,
}

impl Cost {
    /// Of at least one run.
    pub(crate) fn of(mut seconds: Vec<f64>) -> Self {
        seconds.sort_by(f64::total_cmp);
        let [least, most] = [seconds[0], seconds[seconds.len() - 1]];
        Self { median: seconds[seconds.len() / 2], least, most }
    }

    /// Slowest over fastest run.
    pub(crate) fn spread(&self) -> f64 {
        self.most / self.least.max(1e-9)
    }

    /// The same for a part of the work.
    pub(crate) fn per(&self, parts: f64) -> Self {
        Self { median: self.median / parts, least: self.least / parts, most: self.most / parts }
    }
}

/// Runs `work` `runs` times, at least once; its last result, and its cost.
pub(crate) fn cpu_time<T>(runs: usize, mut work: impl FnMut() -> T) -> (T, Cost) {
    let mut seconds = Vec::new();
    let result = loop {
        let clock = ProcessTime::now();
        let result = work();
        seconds.push(clock.elapsed().as_secs_f64());
        if seconds.len() >= runs {
            break result;
        }
    };
    (result, Cost::of(seconds))
}

/// The cost at which runs of (cost, error), by increasing cost, come below
/// `target` to stay, between two of them by a power law; `None` if they do not.
pub(crate) fn time_to(runs: &[[f64; 2]], target: f64) -> Option<f64> {
    let Some(above) = runs.iter().rposition(|run| run[1] > target) else {
        return runs.first().map(|run| run[0]);
    };
    let ([t0, e0], [t1, e1]) = (runs[above], *runs.get(above + 1)?);
    let along = (e0 / target).ln() / (e0 / e1).ln();
    Some(t0 * (t1 / t0).powf(along))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_cost_of_a_target_follows_the_power_law() {
        let runs = [1.0, 4.0, 16.0].map(|t: f64| [t, 1.0 / t.sqrt()]);
        let found = time_to(&runs, 0.4).expect("between 1 and 1/4");
        assert!((found - 6.25).abs() < 1e-12, "{found}");
        assert_eq!(time_to(&runs, 0.1), None, "not reached");
        assert_eq!(time_to(&runs, 2.0), Some(1.0), "the cheapest will do");
        assert_eq!(time_to(&[], 1.0), None);
    }

    #[test]
    fn work_is_run_as_often_as_asked_for() {
        let mut count = 0;
        let (last, cost) = cpu_time(3, || {
            count += 1;
            count
        });
        assert_eq!((last, count), (3, 3));
        assert!(cost.least <= cost.median && cost.median <= cost.most, "{cost:?}");
        assert!(cost.spread() >= 1.0, "{cost:?}");
    }

    #[test]
    fn a_power_law_is_interpolated_exactly() {
        let runs = [1.0, 4.0, 16.0, 64.0].map(|t: f64| [t, 1.0 / t]);
        assert!((time_to(&runs, 0.1).expect("reached") - 10.0).abs() < 1e-12, "1 / 0.1");
        assert_eq!(time_to(&runs, 1e-3), None, "64 s reach 1/64");
        // A lucky hit is not arriving.
        let lucky = [[1.0, 1e-9], [2.0, 0.5], [4.0, 0.25]];
        assert_eq!(time_to(&lucky, 0.25), Some(4.0));
    }
}
