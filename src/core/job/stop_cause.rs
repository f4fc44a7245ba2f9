use serde::{Deserialize, Serialize};

/// Cause of the end of a run that did not reach its goal.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StopCause {
    /// A request to give way to another job: the run ended between two cycles, motors at zero, parts at rest.
    GaveWay,
    /// Pulses, or time without one, brought no part nearer to its target.
    NoProgress,
    /// A cycle had no plan that keeps the limits.
    NoFeasibleStep,
    /// Rotations of the library cannot move the parts independently where they were first seen.
    Uncontrollable,
    /// The plate time limit was reached.
    TimeLimit,
    /// A part cannot be seen any more.
    PartLost,
    /// The camera does not see the parts of the job when the run begins.
    PartCount,
    /// The rig failed.
    DeviceFault,
    /// The camera sees no table.
    TableMissing,
    /// The camera sends the same pictures again and again.
    CameraFrozen,
    /// Numbers or stamps of the camera's frames do not fit the present.
    CameraStale,
    /// The camera's frames show no plate: dark, or garbage.
    CameraDark,
    /// The plate is not where it was in the picture: the camera was knocked, or the plate.
    CameraMoved,
    /// The plate moves later in the pictures than it is driven.
    CameraLate,
    /// Something large hides part of the plate.
    ViewHidden,
    /// Something of a part's size lies on the plate that is no part of the job.
    ForeignPart,
    /// Parts are not where they can have got to.
    PartsJumped,
    /// A voice coil does not do what it is sent.
    CoilFault,
    /// An accelerometer channel does not show how the plate moves.
    AccelerometerFault,
    /// The plate does not move as planned.
    MotionOff,
    /// A part hardly moves although pulses should carry it.
    PartStuck,
    /// A part goes the other way than pulses should carry it.
    PartAstray,
    /// The flag that ends a run was set by an unknown caller.
    Stopped,
    /// The operator interrupted the program.
    Interrupted,
    /// A client asked for it.
    Cancelled,
    /// An operator pressed the emergency stop.
    Estop,
    /// The program ended.
    Shutdown,
    /// The drive lease expired: the control loop did not drive the motors in time.
    LeaseExpired,
    /// A watchdog stopped it for a cause that is not known.
    Watchdog,
    /// A watchdog stopped it: this computer was too slow for the plate, under strict deadlines.
    DeadlineMissed,
    /// A watchdog stopped it: control took no frame for a long time.
    Hung,
    /// A watchdog stopped it: no part was seen for a long time.
    NoPartSeen,
    /// A watchdog stopped it: events of the run could not be stored.
    EventsBlocked,
    /// A watchdog stopped it: the journal could not be written for a long time.
    JournalBlocked,
    /// The journal could not be written.
    JournalLost,
}

impl StopCause {
    /// All of them.
    pub const ALL: [Self; 35] = [
        Self::GaveWay,
        Self::NoProgress,
        Self::NoFeasibleStep,
        Self::Uncontrollable,
        Self::TimeLimit,
        Self::PartLost,
        Self::PartCount,
        Self::DeviceFault,
        Self::TableMissing,
        Self::CameraFrozen,
        Self::CameraStale,
        Self::CameraDark,
        Self::CameraMoved,
        Self::CameraLate,
        Self::ViewHidden,
        Self::ForeignPart,
        Self::PartsJumped,
        Self::CoilFault,
        Self::AccelerometerFault,
        Self::MotionOff,
        Self::PartStuck,
        Self::PartAstray,
        Self::Stopped,
        Self::Interrupted,
        Self::Cancelled,
        Self::Estop,
        Self::Shutdown,
        Self::LeaseExpired,
        Self::Watchdog,
        Self::DeadlineMissed,
        Self::Hung,
        Self::NoPartSeen,
        Self::EventsBlocked,
        Self::JournalBlocked,
        Self::JournalLost,
    ];

    /// Its name in files and on the network, which never changes.
    pub fn code(self) -> &'static str {
        match self {
            Self::GaveWay => "gave_way",
            Self::NoProgress => "no_progress",
            Self::NoFeasibleStep => "no_feasible_step",
            Self::Uncontrollable => "uncontrollable",
            Self::TimeLimit => "time_limit",
            Self::PartLost => "part_lost",
            Self::PartCount => "part_count",
            Self::DeviceFault => "device_fault",
            Self::TableMissing => "table_missing",
            Self::CameraFrozen => "camera_frozen",
            Self::CameraStale => "camera_stale",
            Self::CameraDark => "camera_dark",
            Self::CameraMoved => "camera_moved",
            Self::CameraLate => "camera_late",
            Self::ViewHidden => "view_hidden",
            Self::ForeignPart => "foreign_part",
            Self::PartsJumped => "parts_jumped",
            Self::CoilFault => "coil_fault",
            Self::AccelerometerFault => "accelerometer_fault",
            Self::MotionOff => "motion_off",
            Self::PartStuck => "part_stuck",
            Self::PartAstray => "part_astray",
            Self::Stopped => "stopped",
            Self::Interrupted => "interrupted",
            Self::Cancelled => "cancelled",
            Self::Estop => "estop",
            Self::Shutdown => "shutdown",
            Self::LeaseExpired => "lease_expired",
            Self::Watchdog => "watchdog",
            Self::DeadlineMissed => "deadline_missed",
            Self::Hung => "hung",
            Self::NoPartSeen => "no_part_seen",
            Self::EventsBlocked => "events_blocked",
            Self::JournalBlocked => "journal_blocked",
            Self::JournalLost => "journal_lost",
        }
    }

    /// The cause of that name.
    pub fn of_code(code: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|cause| cause.code() == code)
    }

    /// For people: what the operator should check or change; `None` where there is nothing.
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
            Self::PartsJumped => "check that the picture is not mirrored or turned, and that nobody moves the parts",
            Self::CoilFault => "check the coil, its amplifier and its wires; calibrate again if it was exchanged",
            Self::AccelerometerFault => "check the accelerometer, its cable and its mounting",
            Self::MotionOff => {
                "check power and wires of the amplifiers and that nothing touches the plate; calibrate again"
            }
            Self::PartStuck => "check that the part lies flat and free, and clean it",
            Self::PartAstray => "check the order of the coils and of the picture's axes; calibrate again",
            Self::Hung => "restart the program, and report it",
            Self::NoPartSeen => "check the parts, the light and the camera",
            Self::EventsBlocked | Self::JournalBlocked | Self::JournalLost => "check the disk",
            Self::GaveWay
            | Self::NoFeasibleStep
            | Self::Uncontrollable
            | Self::DeadlineMissed
            | Self::LeaseExpired
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

    /// True for a stop that a person or another job asked for, or that came with the end of the program.
    fn is_by_request(self) -> bool {
        matches!(
            self,
            Self::GaveWay | Self::Stopped | Self::Interrupted | Self::Cancelled | Self::Estop | Self::Shutdown
        )
    }

    /// True for a stop by a watchdog: something was wrong that the run did not see itself.
    pub fn is_by_watchdog(self) -> bool {
        matches!(
            self,
            Self::LeaseExpired
                | Self::Watchdog
                | Self::DeadlineMissed
                | Self::Hung
                | Self::NoPartSeen
                | Self::EventsBlocked
                | Self::JournalBlocked
        )
    }

    /// True for an end by a guard, a watchdog or the time limit: a person looks what is wrong before the plate takes
    /// another job.
    pub fn pauses_plate(self) -> bool {
        let is_of_the_job = matches!(self, Self::NoFeasibleStep | Self::Uncontrollable | Self::JournalLost);
        !is_of_the_job && !self.is_by_request()
    }
}
