//! All that a run can find wrong: one table.

/// Defines [`Finding`] from its table: for each the meaning, the code, the consequence and the check.
macro_rules! findings {
    ($($(#[doc = $meaning:literal])+ $finding:ident = $code:literal, $effect:ident, $check:literal;)+) => {
        crate::coded_enum! {
            /// Something that is not as it should be, as a run saw it.
            #[derive(schemars::JsonSchema)]
            pub enum Finding { $($(#[doc = $meaning])+ $finding = $code,)+ }
        }

        impl Finding {
            /// The meaning, for people.
            #[cfg(test)]
            fn meaning(self) -> &'static str {
                match self { $(Self::$finding => concat!($($meaning),+).trim_ascii(),)+ }
            }

            /// The check or change that helps, for people.
            pub fn check(self) -> &'static str {
                match self { $(Self::$finding => $check,)+ }
            }

            /// The consequence for the run.
            pub fn effect(self) -> Effect {
                match self { $(Self::$finding => Effect::$effect,)+ }
            }
        }
    };
}

findings! {
    /// The whole steps of a cycle would take a part over the edge margin.
    StepsMeetEdge = "steps_meet_edge", GoesOn, "targets farther from the edge help";
    /// The whole steps of a cycle would bring two parts closer than the gap they must keep.
    StepsMeetParts = "steps_meet_parts", GoesOn, "more room between the targets helps, or another order of arrival";
    /// No motion was found that moves every part that should move.
    StepsUnreachable = "steps_unreachable", GoesOn,
        "check the library's coverage with `upm check LIBRARY.json`, or take another planner";
    /// The planner's solver gave up.
    SolverFails = "solver_fails", GoesOn, "check the library with `upm check LIBRARY.json`, or take another planner";
    /// No path leads the part to its target past the other parts.
    PartBlocked = "part_blocked", GoesOn, "it waits until the others have moved; if they never do, change the targets";
    /// The part moves much less far than calibration predicts.
    PartSlow = "part_slow", GoesOn, "clean the part and the plate under it, or calibrate again if every part is slow";
    /// The last lap took longer than its speed asks.
    LapLate = "lap_late", GoesOn, "`upm check --plan` gives the speed that can be held";
    /// A part leaves the corridor along its path.
    CorridorLeft = "corridor_left", GoesOn, "a slower speed or a wider `corridor_mm` helps";
    /// An accelerometer channel does not follow the plate's motion.
    AccelerometerFault = "accelerometer_fault", Slows, "check the accelerometer, its cable and its mounting";
    /// A voice coil does not follow its signal.
    CoilFault = "coil_fault", SlowsOrPauses,
        "check the coil, its amplifier and its wires; calibrate again if it was exchanged";
    /// The plate does not move as planned.
    MotionOff = "motion_off", SlowsOrPauses,
        "check power and wires of the amplifiers and that nothing touches the plate; calibrate again";
    /// The camera sends the same pictures again and again.
    CameraFrozen = "camera_frozen", Waits, "check the camera, its cable and its driver; start it again";
    /// Frame numbers or time stamps of the camera do not fit the present.
    CameraStale = "camera_stale", Waits,
        "check the clock that stamps the frames, and that no frames pile up on their way";
    /// The camera's frames show no plate: they are dark or garbage.
    CameraDark = "camera_dark", Waits, "check the light, the lens cap and the cable";
    /// Something large hides part of the plate.
    ViewHidden = "view_hidden", Waits, "keep hands and tools out of the camera's view";
    /// The camera's frames show no table.
    TableMissing = "table_missing", Waits, "check light, focus and that the whole plate is in view";
    /// The plate's place in the picture has changed: the camera or the plate was knocked.
    CameraMoved = "camera_moved", Locates, "check that the camera and the plate's frame are tight";
    /// The plate's motion in the pictures lags behind the drive.
    CameraLate = "camera_late", Pauses, "check how many frames the camera's driver buffers";
    /// An object of a part's size lies on the plate that does not belong to the job.
    ForeignPart = "foreign_part", Pauses, "take it off the plate, or add it to the job";
    /// Parts are where no motion since the last frame can have taken them.
    PartsJumped = "parts_jumped", Pauses,
        "check that the picture is not mirrored or turned, and that no hand moves the parts";
    /// A part hardly moves although pulses should carry it.
    PartStuck = "part_stuck", Pauses, "check that the part lies flat and free, and clean it";
    /// Pulses, or time without one, brought no part nearer to its target.
    NoProgress = "no_progress", Pauses, "check that the parts lie flat and free, and that the targets can be reached";
    /// Parts wait for each other: none came nearer to its target past the others.
    PartsHinder = "parts_hinder", Ends,
        "more room between places or paths helps, or fewer parts at a time: `tasks` that name their `parts`";
    /// The plate time limit was reached.
    TimeLimit = "time_limit", Pauses, "check that the parts move freely, or give the job more time";
    /// A part cannot be seen any more.
    PartLost = "part_lost", Pauses, "find the part and put it back, or take it out of the job";
    /// The camera does not see the parts of the job when the run begins.
    PartCount = "part_count", Pauses, "put the parts of the job on the plate, and nothing else";
    /// The rig failed.
    DeviceFault = "device_fault", Pauses, "check the rig's power and cables";
    /// A cycle had no plan that keeps the limits.
    NoFeasibleStep = "no_feasible_step", Ends, "";
    /// Rotations of the library cannot move the parts independently where they were first seen.
    Uncontrollable = "uncontrollable", Ends, "";
    /// The journal could not be written.
    JournalLost = "journal_lost", Ends, "check the disk";
    /// The drive lease expired: the control loop did not drive the motors in time.
    LeaseExpired = "lease_expired", Pauses, "end other programs on this computer, or run fewer plates on it at a time";
    /// The drive lease expired in real time: this computer was too slow for the plate, under strict deadlines.
    DeadlineMissed = "deadline_missed", Pauses,
        "end other programs on this computer, or run fewer plates on it at a time";
    /// A watchdog stopped it for a cause that is not known.
    Watchdog = "watchdog", Pauses, "";
    /// A watchdog stopped it: control took no frame for a long time.
    Hung = "hung", Pauses, "restart the program, and report it";
    /// A watchdog stopped it: no part was seen for a long time.
    NoPartSeen = "no_part_seen", Pauses, "check the parts, the light and the camera";
    /// A watchdog stopped it: the journal could not be written for a long time.
    JournalBlocked = "journal_blocked", Pauses, "check the disk";
}

/// Consequence of a finding for its run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Effect {
    /// It goes on.
    GoesOn,
    /// It goes on in shorter steps.
    Slows,
    /// It goes on in shorter steps where the deviation is small, and ends otherwise; the plate is paused.
    SlowsOrPauses,
    /// The motors fall silent. It waits for the finding to pass, and ends otherwise; the plate is paused.
    Waits,
    /// Table and parts are located anew. It ends where that fails; the plate is paused.
    Locates,
    /// It ends.
    Ends,
    /// It ends, and the plate is paused: the operator has to check it before it takes another job.
    Pauses,
}

#[cfg(test)]
mod tests {
    use super::*;

    impl Effect {
        fn text(self) -> &'static str {
            match self {
                Self::GoesOn => "goes on",
                Self::Slows => "goes on in shorter steps",
                Self::SlowsOrPauses => "small: goes on in shorter steps; else ends",
                Self::Waits => "motors silent, waits, ends",
                Self::Locates => "locates table and parts anew, or ends",
                Self::Ends => "ends; the plate goes on",
                Self::Pauses => "ends",
            }
        }
    }

    /// The table in the documents. `UPM_REMAKE_GOLDEN=1` writes it anew.
    #[test]
    fn documents_have_the_table() {
        let cells = |of: Finding| (of.code(), of.meaning().trim_end_matches('.'), of.effect().text());
        let rows = Finding::ALL.into_iter().map(cells);
        let rows: String =
            rows.map(|(code, meaning, effect)| format!("| `{code}` | {meaning} | {effect} |\n")).collect();
        let table = format!("| code | finds | the run |\n|---|---|---|\n{rows}");
        let file = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/faults.md");
        let page = std::fs::read_to_string(file).unwrap();
        let begin = page.find("| code | finds").unwrap();
        let end = begin + page[begin..].find("\n\n").unwrap() + 1;
        if std::env::var_os("UPM_REMAKE_GOLDEN").is_some() {
            std::fs::write(file, [&page[..begin], &table, &page[end..]].concat()).unwrap();
        } else {
            assert_eq!(page[begin..end], table);
        }
    }

    #[test]
    fn findings_that_change_a_run_say_what_to_check() {
        let silent = Finding::ALL.into_iter().filter(|finding| finding.check().is_empty());
        assert_eq!(
            silent.collect::<Vec<_>>(),
            [Finding::NoFeasibleStep, Finding::Uncontrollable, Finding::Watchdog],
            "their reasons say it"
        );
    }
}
