use crate::coded_enum;

coded_enum! {
    /// Cause of the end of a run that did not reach its goal.
    #[derive(schemars::JsonSchema)]
    pub enum StopCause {
        /// A request to give way to another job: the run ended between two cycles, motors at zero, parts at rest.
        GaveWay = "gave_way",
        /// Pulses, or time without one, brought no part nearer to its target.
        NoProgress = "no_progress",
        /// A cycle had no plan that keeps the limits.
        NoFeasibleStep = "no_feasible_step",
        /// Rotations of the library cannot move the parts independently where they were first seen.
        Uncontrollable = "uncontrollable",
        /// The plate time limit was reached.
        TimeLimit = "time_limit",
        /// A part cannot be seen any more.
        PartLost = "part_lost",
        /// The camera does not see the parts of the job when the run begins.
        PartCount = "part_count",
        /// The rig failed.
        DeviceFault = "device_fault",
        /// The camera sees no table.
        TableMissing = "table_missing",
        /// The camera sends the same pictures again and again.
        CameraFrozen = "camera_frozen",
        /// Frame numbers or time stamps of the camera do not fit the present.
        CameraStale = "camera_stale",
        /// The camera's frames show no plate: they are dark or garbage.
        CameraDark = "camera_dark",
        /// The plate's place in the picture has changed: the camera or the plate was knocked.
        CameraMoved = "camera_moved",
        /// The plate's motion in the pictures lags behind the drive.
        CameraLate = "camera_late",
        /// Something large hides part of the plate.
        ViewHidden = "view_hidden",
        /// An object of a part's size lies on the plate that does not belong to the job.
        ForeignPart = "foreign_part",
        /// Parts are where no motion since the last frame can have taken them.
        PartsJumped = "parts_jumped",
        /// A voice coil does not follow its signal.
        CoilFault = "coil_fault",
        /// An accelerometer channel does not follow the plate's motion.
        AccelerometerFault = "accelerometer_fault",
        /// The plate does not move as planned.
        MotionOff = "motion_off",
        /// A part hardly moves although pulses should carry it.
        PartStuck = "part_stuck",
        /// A part moves against the direction in which pulses should carry it.
        PartAstray = "part_astray",
        /// The flag that ends a run was set by an unknown caller.
        Stopped = "stopped",
        /// The operator interrupted the program.
        Interrupted = "interrupted",
        /// A client asked for it.
        Cancelled = "cancelled",
        /// An operator pressed the emergency stop.
        Estop = "estop",
        /// The program ended.
        Shutdown = "shutdown",
        /// The drive lease expired: the control loop did not drive the motors in time.
        LeaseExpired = "lease_expired",
        /// A watchdog stopped it for a cause that is not known.
        Watchdog = "watchdog",
        /// The drive lease expired in real time: this computer was too slow for the plate, under strict deadlines.
        DeadlineMissed = "deadline_missed",
        /// A watchdog stopped it: control took no frame for a long time.
        Hung = "hung",
        /// A watchdog stopped it: no part was seen for a long time.
        NoPartSeen = "no_part_seen",
        /// A watchdog stopped it: the journal could not be written for a long time.
        JournalBlocked = "journal_blocked",
        /// The journal could not be written.
        JournalLost = "journal_lost",
    }
}

impl StopCause {
    /// Advice for the operator on what to check or change; `None` without advice.
    pub fn remedy(self) -> Option<&'static str> {
        Some(match self {
            Self::NoProgress => "check that the parts lie flat and free, and that the targets can be reached",
            Self::TimeLimit => "check that the parts move freely, or give the job more time",
            Self::PartLost => "find the part and put it back, or take it out of the job",
            Self::PartCount => "put the parts of the job on the plate, and nothing else",
            Self::DeviceFault => "check the rig's power and cables",
            Self::TableMissing => "check light, focus and that the whole plate is in view",
            Self::CameraFrozen => "check the camera, its cable and its driver; start it again",
            Self::CameraStale => "check the clock that stamps the frames, and that no frames pile up on their way",
            Self::CameraDark => "check the light, the lens cap and the cable",
            Self::CameraMoved => "check that the camera and the plate's frame are tight",
            Self::CameraLate => "check how many frames the camera's driver buffers",
            Self::ViewHidden => "keep hands and tools out of the camera's view",
            Self::ForeignPart => "take it off the plate, or add it to the job",
            Self::PartsJumped => "check that the picture is not mirrored or turned, and that no hand moves the parts",
            Self::CoilFault => "check the coil, its amplifier and its wires; calibrate again if it was exchanged",
            Self::AccelerometerFault => "check the accelerometer, its cable and its mounting",
            Self::MotionOff => {
                "check power and wires of the amplifiers and that nothing touches the plate; calibrate again"
            }
            Self::PartStuck => "check that the part lies flat and free, and clean it",
            Self::PartAstray => "check the order of the coils and of the picture's axes; calibrate again",
            Self::DeadlineMissed | Self::LeaseExpired => {
                "end other programs on this computer, or run fewer plates on it at a time"
            }
            Self::Hung => "restart the program, and report it",
            Self::NoPartSeen => "check the parts, the light and the camera",
            Self::JournalBlocked | Self::JournalLost => "check the disk",
            Self::GaveWay
            | Self::NoFeasibleStep
            | Self::Uncontrollable
            | Self::Watchdog
            | Self::Stopped
            | Self::Interrupted
            | Self::Cancelled
            | Self::Estop
            | Self::Shutdown => return None,
        })
    }

    /// True for a stop from outside the run: a repetition of the run does not end there.
    pub fn is_external(self) -> bool {
        self.is_by_watchdog() || self.is_by_request() || self == Self::JournalLost
    }

    /// True for a stop that a person or another job asked for, or that the end of the program caused.
    fn is_by_request(self) -> bool {
        matches!(
            self,
            Self::GaveWay | Self::Stopped | Self::Interrupted | Self::Cancelled | Self::Estop | Self::Shutdown
        )
    }

    /// True for a stop by a watchdog, which detects faults that the run itself cannot.
    pub fn is_by_watchdog(self) -> bool {
        matches!(
            self,
            Self::LeaseExpired
                | Self::Watchdog
                | Self::DeadlineMissed
                | Self::Hung
                | Self::NoPartSeen
                | Self::JournalBlocked
        )
    }

    /// True for an end by a guard, a watchdog or the time limit: the operator has to check the plate before it takes
    /// another job.
    pub fn pauses_plate(self) -> bool {
        let is_of_the_job = matches!(self, Self::NoFeasibleStep | Self::Uncontrollable | Self::JournalLost);
        !is_of_the_job && !self.is_by_request()
    }
}
