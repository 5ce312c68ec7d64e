use super::*;

#[test]
fn detections_that_come_late_make_nothing_older() {
    let mut monitor = Monitor::default();
    for stamp in [1.0, 3.0, 2.0] {
        monitor.heard(stamp);
    }
    assert_eq!(monitor.detections, Some(3.0));
}
