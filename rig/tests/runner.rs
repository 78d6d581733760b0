//! The runner on a rig that exists only here: stopping, going on, damage and failing devices.

mod common;

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};

use common::*;
use rig::{
    Bench, DeviceError, DeviceErrorKind, Event, Outcome, Pattern, RunError, RunOptions, Shot,
    StopStatus, Target, read_frame, read_journal, run,
};

#[test]
fn frames_come_back_with_all_that_is_known_about_them() {
    let folder = tempfile::tempdir().unwrap();
    let (mut rig, scene) = fake();
    go(&mut rig, &plan(), folder.path(), None).unwrap();
    assert_eq!(files(folder.path()).len(), FRAMES);
    // The sheet, then the sample once.
    assert_eq!(scene.placements.load(Ordering::Relaxed), 2);
    assert_eq!(last_status(folder.path()), StopStatus::Done);

    let path = folder.path().join("frames/region-01/region-01-e1-r1.png");
    let (frame, metadata) = read_frame(&path).unwrap();
    assert_eq!(
        (metadata.shot.as_str(), metadata.exposure_index, metadata.repeat),
        ("region-01", 1, 1)
    );
    assert_eq!((metadata.requested_s, frame.exposure_s), (1.0, 1.01));
    assert_eq!(metadata.pattern, Pattern::region(2, 2, 0));
    assert_eq!((frame.bit_depth, frame.channels, frame.data.len()), (12, 3, 72));

    // The same conditions again, straight from the camera: the pixels went through unchanged.
    let map = |[x, y]: [f64; 2]| Some([x / 15.0, y / 7.0]);
    rig.projector.show(&metadata.pattern.render(16, 8, Some(&map)).unwrap()).unwrap();
    assert_eq!(rig.camera.expose(1.0).unwrap(), frame);

    let written = events(folder.path()).into_iter().filter_map(|event| match event {
        Event::FrameWritten { file, stats, .. } => Some((file, stats)),
        _ => None,
    });
    let stats: BTreeMap<_, _> = written.collect();
    assert_eq!(stats["frames/region-01/region-01-e1-r1.png"], frame.stats());
}

#[test]
fn a_run_stopped_after_any_frame_goes_on_to_the_identical_set() {
    let whole = reference();
    for stop_after in 0..FRAMES {
        let folder = tempfile::tempdir().unwrap();
        let first = go(&mut fake().0, &plan(), folder.path(), Some(stop_after)).unwrap();
        assert_eq!(first, Outcome { taken: stop_after, kept: 0, missing: FRAMES - stop_after });
        assert_eq!(last_status(folder.path()), StopStatus::Stopped);
        // As after a power failure: the last line of the journal was never finished.
        let journal = folder.path().join("journal.jsonl");
        let bytes = std::fs::read(&journal).unwrap();
        std::fs::write(&journal, &bytes[..bytes.len() - 9]).unwrap();

        let (mut rig, scene) = fake();
        let second = go(&mut rig, &plan(), folder.path(), None).unwrap();
        let missing = FRAMES - stop_after;
        assert_eq!(second, Outcome { taken: missing, kept: stop_after, missing: 0 });
        assert_eq!(scene.exposures.load(Ordering::Relaxed), missing);
        assert_eq!(files(folder.path()), whole, "stopped after {stop_after}");
    }
}

#[test]
fn a_finished_run_repeated_touches_nothing() {
    let folder = tempfile::tempdir().unwrap();
    go(&mut fake().0, &plan(), folder.path(), None).unwrap();
    let (mut rig, scene) = fake();
    let again = go(&mut rig, &plan(), folder.path(), None).unwrap();
    assert_eq!(again, Outcome { taken: 0, kept: FRAMES, missing: 0 });
    assert_eq!(scene.placements.load(Ordering::Relaxed), 0);
}

/// Killed between a frame's name and its line: the frame is there, and says what it is.
#[test]
fn a_frame_whose_line_is_torn_is_known_by_what_it_says_of_itself() {
    let folder = tempfile::tempdir().unwrap();
    go(&mut fake().0, &plan(), folder.path(), None).unwrap();
    let journal = folder.path().join("journal.jsonl");
    let text = std::fs::read_to_string(&journal).unwrap();
    // Up to the middle of the line about the last frame.
    let last = text.rfind("frame-written").unwrap();
    let cut = || std::fs::write(&journal, &text[..last]).unwrap();
    cut();
    // What a killed run had begun.
    let unfinished = folder.path().join("frames/region-01/.part-abc");
    std::fs::write(&unfinished, "half a fr").unwrap();
    let again = go(&mut fake().0, &plan(), folder.path(), None).unwrap();
    assert_eq!(again, Outcome { taken: 0, kept: FRAMES, missing: 0 });
    assert!(!unfinished.exists());
    assert_eq!(files(folder.path()), reference());
    let notes = events(folder.path()).into_iter().filter(|e| matches!(e, Event::Note { .. }));
    assert_eq!(notes.count(), 2);
    // From then on the journal knows it.
    let last_frame = |events: Vec<Event>| {
        events.into_iter().rev().find(|event| matches!(event, Event::FrameWritten { .. }))
    };
    let whole = tempfile::tempdir().unwrap();
    go(&mut fake().0, &plan(), whole.path(), None).unwrap();
    assert_eq!(last_frame(events(folder.path())), last_frame(events(whole.path())));

    // Under a plan that asks for something else it is nobody's.
    cut();
    let mut changed = plan();
    changed.shots[3].pattern = Pattern::region(2, 2, 2);
    let again = go(&mut fake().0, &changed, folder.path(), None).unwrap();
    assert_eq!(again, Outcome { taken: 1, kept: FRAMES - 1, missing: 0 });
    let mut found = files(folder.path());
    let aside = found.remove("region-04-e0-r0.png.set-aside-1").unwrap();
    assert_eq!(aside, reference()["region-04-e0-r0.png"]);
    // Nor is one that is damaged.
    cut();
    let path = folder.path().join("frames/region-04/region-04-e0-r0.png");
    let mut bytes = std::fs::read(&path).unwrap();
    let middle = bytes.len() - 40;
    bytes[middle] ^= 1;
    std::fs::write(&path, &bytes).unwrap();
    let again = go(&mut fake().0, &changed, folder.path(), None).unwrap();
    assert_eq!(again, Outcome { taken: 1, kept: FRAMES - 1, missing: 0 });
}

#[test]
fn damaged_and_missing_frames_are_taken_again() {
    let folder = tempfile::tempdir().unwrap();
    go(&mut fake().0, &plan(), folder.path(), None).unwrap();
    let damaged = folder.path().join("frames/black/black-e1-r0.png");
    let mut bytes = std::fs::read(&damaged).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    std::fs::write(&damaged, &bytes).unwrap();
    std::fs::remove_file(folder.path().join("frames/sheet/sheet-e0-r1.png")).unwrap();

    let again = go(&mut fake().0, &plan(), folder.path(), None).unwrap();
    assert_eq!(again, Outcome { taken: 2, kept: FRAMES - 2, missing: 0 });
    let mut found = files(folder.path());
    assert_eq!(found.remove("black-e1-r0.png.set-aside-1"), Some(bytes));
    assert_eq!(found, reference());
    // And then it is whole again.
    assert_eq!(go(&mut fake().0, &plan(), folder.path(), None).unwrap().kept, FRAMES);
}

#[test]
fn a_changed_plan_does_not_mix_with_what_is_there() {
    let folder = tempfile::tempdir().unwrap();
    go(&mut fake().0, &plan(), folder.path(), None).unwrap();
    let mut changed = plan();
    changed.shots[2].exposures_s[1] = 2.0;
    let error = go(&mut fake().0, &changed, folder.path(), None).unwrap_err();
    assert!(
        matches!(&error, RunError::OtherSettings { shot, file } if shot == "region-01" && file.ends_with("region-01-e1-r0.png")),
        "{error}"
    );
    assert_eq!(files(folder.path()), reference());
    // A plan that only goes further is welcome.
    let mut longer = plan();
    longer.shots.push(Shot { name: "more".into(), ..longer.shots[3].clone() });
    let outcome = go(&mut fake().0, &longer, folder.path(), None).unwrap();
    assert_eq!(outcome, Outcome { taken: 1, kept: FRAMES, missing: 0 });
}

#[test]
fn passing_failures_are_sat_out_and_lasting_ones_reported() {
    let timeout = || DeviceError::Timeout { device: "fake".into(), waited_s: 5.0 };
    let folder = tempfile::tempdir().unwrap();
    let (mut rig, scene) = fake();
    scene.faults.lock().unwrap().extend([timeout(), timeout(), timeout()]);
    go(&mut rig, &plan(), folder.path(), None).unwrap();
    assert_eq!(files(folder.path()), reference());
    let notes = events(folder.path()).into_iter().filter(|e| matches!(e, Event::Note { .. }));
    assert_eq!(notes.count(), 3);

    // One more than is sat out, and one that will not pass at all.
    let gone = || DeviceError::Disconnected { device: "fake".into() };
    let cases: [(Vec<DeviceError>, DeviceErrorKind); 2] = [
        (vec![timeout(), timeout(), timeout(), timeout()], DeviceErrorKind::Timeout),
        ((0..8).map(|_| gone()).collect(), DeviceErrorKind::Disconnected),
    ];
    for (faults, kind) in cases {
        let folder = tempfile::tempdir().unwrap();
        let (mut rig, scene) = fake();
        go(&mut rig, &plan(), folder.path(), Some(4)).unwrap();
        scene.faults.lock().unwrap().extend(faults);
        match go(&mut rig, &plan(), folder.path(), None) {
            Err(RunError::Device { shot, source }) => {
                assert_eq!((shot.as_str(), source.kind()), ("region-01", kind));
            }
            other => panic!("{other:?}"),
        }
        assert_eq!(last_status(folder.path()), StopStatus::Failed);
        // Nothing was lost, and the device works again.
        let outcome = go(&mut rig, &plan(), folder.path(), None).unwrap();
        assert_eq!(outcome, Outcome { taken: FRAMES - 4, kept: 4, missing: 0 });
        assert_eq!(files(folder.path()), reference());
    }
}

/// Somebody who is asked to put a thing in place and stops instead.
struct Stopping(&'static AtomicBool);

impl Bench for Stopping {
    fn place(&mut self, target: &Target) -> Result<(), DeviceError> {
        if *target != Target::Sample {
            return Ok(());
        }
        self.0.store(true, Ordering::Relaxed);
        Err(DeviceError::Declined { device: "technician".into(), reason: "stopped".into() })
    }
}

#[test]
fn who_stops_at_a_placement_has_interrupted_the_run_and_not_broken_it() {
    static STOP: AtomicBool = AtomicBool::new(false);
    let folder = tempfile::tempdir().unwrap();
    let (mut rig, _) = fake();
    rig.bench = Box::new(Stopping(&STOP));
    let face = |[x, y]: [f64; 2]| Some([x / 16.0, y / 8.0]);
    let options = |stop| RunOptions { face_map: Some(&face), ..RunOptions::new(stop) };
    let outcome = run(&plan(), &mut rig, folder.path(), options(&STOP), &mut |_| {});
    assert_eq!(outcome.unwrap(), Outcome { taken: 2, kept: 0, missing: FRAMES - 2 });
    let entries = read_journal(&folder.path().join("journal.jsonl")).unwrap().entries;
    let last = &entries.last().unwrap().event;
    assert!(matches!(last, Event::Stopped { status: StopStatus::Stopped, .. }), "{last:?}");
    assert!(
        !entries
            .iter()
            .any(|entry| matches!(&entry.event, Event::Placed { target: Target::Sample, .. }))
    );

    // The same without being asked to stop is a failure.
    STOP.store(false, Ordering::Relaxed);
    let no = AtomicBool::new(false);
    let refused = run(&plan(), &mut rig, folder.path(), options(&no), &mut |_| {});
    assert!(matches!(refused, Err(RunError::Device { .. })), "{refused:?}");
}

#[test]
fn an_impossible_frame_is_not_written() {
    let folder = tempfile::tempdir().unwrap();
    let (mut rig, scene) = fake();
    scene.impossible.store(true, Ordering::Relaxed);
    let message = go(&mut rig, &plan(), folder.path(), None).unwrap_err().to_string();
    assert!(message.contains("sheet") && message.contains("4096"), "{message}");
    assert!(files(folder.path()).is_empty());
}

/// Nobody is asked to change the bench for frames that cannot be kept.
#[test]
fn what_cannot_be_written_ends_the_run_before_the_bench_is_touched() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("frames")).unwrap();
    std::fs::write(folder.path().join("frames/sheet"), "in the way of its folder").unwrap();
    let (mut rig, scene) = fake();
    let outcome = go(&mut rig, &plan(), folder.path(), None);
    assert!(matches!(&outcome, Err(RunError::File(_))), "{outcome:?}");
    assert_eq!(scene.placements.load(Ordering::Relaxed), 1);
    assert_eq!(last_status(folder.path()), StopStatus::Failed);
}

#[test]
fn a_pattern_on_the_face_needs_a_calibrated_projector() {
    let folder = tempfile::tempdir().unwrap();
    let stop = AtomicBool::new(false);
    let options = RunOptions::new(&stop);
    let error = run(&plan(), &mut fake().0, folder.path(), options, &mut |_| ()).unwrap_err();
    assert!(matches!(error, RunError::NoFaceMap(shot) if shot == "region-01"));
    assert!(files(folder.path()).is_empty());
}

#[test]
fn cut_and_damaged_frames_are_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    go(&mut fake().0, &plan(), folder.path(), None).unwrap();
    let path = folder.path().join("frames/black/black-e0-r0.png");
    let bytes = std::fs::read(&path).unwrap();
    let read = |bytes: &[u8]| {
        std::fs::write(&path, bytes).unwrap();
        read_frame(&path)
    };
    let good = read(&bytes).unwrap();
    for cut in 0..bytes.len() {
        let error = read(&bytes[..cut]).expect_err("a cut file");
        assert!(error.to_string().contains("black-e0-r0.png"), "cut at {cut}: {error}");
    }
    for at in 0..bytes.len() {
        let mut flipped = bytes.clone();
        flipped[at] ^= 16;
        // Chunks carry checksums: what is not refused must be what was written.
        if let Ok(frame) = read(&flipped) {
            assert_eq!(frame, good, "byte {at}");
        }
    }
}
