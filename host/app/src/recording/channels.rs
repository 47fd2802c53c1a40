//! The channels of a recording: names, schemas, encodings.
//!
//! What follows from the link is in the messages of ROS 2 where there are such, and otherwise in messages of our own whose
//! fields carry their units: a recording opens in whatever reads `ros2msg` schemas. What a session made of its clock, and
//! what is counted, is JSON.

use std::collections::BTreeMap;

use palpate_files::mcap::Channel;

/// A channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Kind {
    /// Bytes from the device.
    Received,
    /// Bytes to the device.
    Sent,
    /// What no byte tells.
    Events,
    /// What came in beside the link.
    Inputs,
    /// What was counted.
    Counters,
    /// Force as calibrated, tare included.
    WrenchRaw,
    /// Force less the tare.
    Wrench,
    /// What the finger touches.
    Contact,
    /// Where the part most probably is.
    Pose,
    /// Everywhere that it may be.
    Belief,
    /// The same pose as a transform.
    Transforms,
    /// Part and finger, to be drawn.
    Scene,
    /// Where a body touches a palm.
    PalmContact,
    /// How that body is turned.
    PalmAttitude,
    /// What the person was told.
    Log,
}

impl Kind {
    /// The channel's name.
    pub(super) fn topic(self) -> &'static str {
        match self {
            Self::Received => "/link/received",
            Self::Sent => "/link/sent",
            Self::Events => "/link/events",
            Self::Inputs => "/inputs",
            Self::Counters => "/link/counters",
            Self::WrenchRaw => "/finger/wrench_raw",
            Self::Wrench => "/finger/wrench",
            Self::Contact => "/finger/contact",
            Self::Pose => "/part/pose",
            Self::Belief => "/part/belief",
            Self::Transforms => "/tf",
            Self::Scene => "/scene",
            Self::PalmContact => "/palm/contact",
            Self::PalmAttitude => "/palm/attitude",
            Self::Log => "/log",
        }
    }

    /// The channel of this name.
    pub(super) fn of(topic: &str) -> Option<Self> {
        [Self::Received, Self::Sent, Self::Events, Self::Inputs].into_iter().find(|kind| kind.topic() == topic)
    }

    /// As the file describes it; forces are in `unit`.
    pub(super) fn channel(self, unit: &str) -> Channel {
        let (schema_name, parts): (&str, &[&str]) = match self {
            Self::Received | Self::Sent => ("palpate_msgs/msg/LinkBytes", &[LINK_BYTES]),
            Self::Events => ("palpate.LinkEvent", &[EVENT]),
            Self::Inputs => ("palpate.Input", &[INPUT]),
            Self::Counters => ("palpate.Counters", &[COUNTERS]),
            Self::WrenchRaw | Self::Wrench => {
                ("geometry_msgs/msg/WrenchStamped", &[WRENCH_STAMPED, HEADER, TIME, WRENCH, VECTOR3])
            }
            Self::Contact => ("palpate_msgs/msg/Contact", &[CONTACT, HEADER, TIME]),
            Self::Pose => (
                "geometry_msgs/msg/PoseWithCovarianceStamped",
                &[POSE_STAMPED, HEADER, TIME, POSE_WITH_COVARIANCE, POSE, POINT, QUATERNION],
            ),
            Self::Belief => ("palpate_msgs/msg/Belief", &[BELIEF, HEADER, TIME, HYPOTHESIS]),
            Self::Transforms => (
                "tf2_msgs/msg/TFMessage",
                &[TF_MESSAGE, TRANSFORM_STAMPED, HEADER, TIME, TRANSFORM, VECTOR3, QUATERNION],
            ),
            Self::Scene => (
                "visualization_msgs/msg/MarkerArray",
                &[
                    MARKER_ARRAY,
                    MARKER,
                    HEADER,
                    TIME,
                    DURATION,
                    POSE,
                    POINT,
                    QUATERNION,
                    VECTOR3,
                    COLOUR,
                    COMPRESSED_IMAGE,
                    UV_COORDINATE,
                    MESH_FILE,
                ],
            ),
            Self::PalmContact => ("geometry_msgs/msg/PointStamped", &[POINT_STAMPED, HEADER, TIME, POINT]),
            Self::PalmAttitude => {
                ("geometry_msgs/msg/QuaternionStamped", &[QUATERNION_STAMPED, HEADER, TIME, QUATERNION])
            }
            Self::Log => ("rcl_interfaces/msg/Log", &[LOG, TIME]),
        };
        let is_json = matches!(self, Self::Events | Self::Inputs | Self::Counters);
        let (message_encoding, schema_encoding) = if is_json { ("json", "jsonschema") } else { ("cdr", "ros2msg") };
        let is_force = matches!(self, Self::WrenchRaw | Self::Wrench | Self::Contact);
        Channel {
            topic: self.topic().to_owned(),
            message_encoding: message_encoding.to_owned(),
            schema_name: schema_name.to_owned(),
            schema_encoding: schema_encoding.to_owned(),
            schema: parts.join(BETWEEN),
            metadata: is_force
                .then(|| ("unit_of_force".to_owned(), unit.to_owned()))
                .into_iter()
                .collect::<BTreeMap<_, _>>(),
        }
    }
}

/// Stands between the definitions of a `ros2msg` schema.
const BETWEEN: &str = "================================================================================\n";

const LINK_BYTES: &str = "\
# Bytes of the link: a frame with its delimiter, or a part of one
uint64 host_ns # when, since the session began
uint8[] data
";

const EVENT: &str = r#"{"title":"palpate.LinkEvent","type":"object","properties":{"host_ns":{"type":"integer","description":"since the session began"},"what":{"type":"string"}},"required":["host_ns","what"]}"#;

const INPUT: &str = r#"{"title":"palpate.Input","type":"object","properties":{"host_ns":{"type":"integer","description":"since the session began"},"source":{"type":"string"},"line":{"type":["string","null"],"description":"null where it ended"}},"required":["host_ns","source"]}"#;

const COUNTERS: &str = r#"{"title":"palpate.Counters","type":"object","properties":{"samples":{"type":"integer"},"missing":{"type":"integer"},"repeated":{"type":"integer"},"damaged_frames":{"type":"integer"},"unknown_messages":{"type":"integer"},"commands_repeated":{"type":"integer"},"disconnections":{"type":"integer"},"restarts":{"type":"integer"},"temperature_c":{"type":["number","null"]}}}"#;

const WRENCH_STAMPED: &str = "std_msgs/Header header\ngeometry_msgs/Wrench wrench\n";

const CONTACT: &str = "\
# What the finger touches, finger axes
std_msgs/Header header
float64 device_s # the device's clock
bool measured # false: the sample was no measurement
bool touching
float64 u_rad # polar angle of the contact; NaN without one
float64 u_sd_rad
float64 friction_half_angle_rad
float64 force_x # less the tare, in the channel's unit_of_force
float64 force_y
float64 magnitude_sd
";

const BELIEF: &str = "\
# Everywhere that the part may be; none where nothing explains the force
std_msgs/Header header
float64 felt_s # up to when the push was used, since it began; NaN where it was slow and only its way counts
uint32 part # number of the part on the command line, from 0
palpate_msgs/Hypothesis[] hypotheses
";

const HYPOTHESIS: &str = "\
MSG: palpate_msgs/Hypothesis
float64 probability
uint32 edge # in contact, as in the part file, from 0
float64 x_m # the part's frame in that of the finger's motion
float64 y_m
float64 theta_rad
float64[9] covariance # of x, y, theta, row by row; NaN where it is not known
";

const POSE_STAMPED: &str = "std_msgs/Header header\ngeometry_msgs/PoseWithCovariance pose\n";
const TF_MESSAGE: &str = "geometry_msgs/TransformStamped[] transforms\n";
const LOG: &str = "\
builtin_interfaces/Time stamp
uint8 level
string name
string msg
string file
string function
uint32 line
";

const MARKER_ARRAY: &str = "visualization_msgs/Marker[] markers\n";
const MARKER: &str = "\
MSG: visualization_msgs/Marker
std_msgs/Header header
string ns
int32 id
int32 type
int32 action
geometry_msgs/Pose pose
geometry_msgs/Vector3 scale
std_msgs/ColorRGBA color
builtin_interfaces/Duration lifetime
bool frame_locked
geometry_msgs/Point[] points
std_msgs/ColorRGBA[] colors
string texture_resource
sensor_msgs/CompressedImage texture
visualization_msgs/UVCoordinate[] uv_coordinates
string text
string mesh_resource
visualization_msgs/MeshFile mesh_file
bool mesh_use_embedded_materials
";
const POINT_STAMPED: &str = "std_msgs/Header header\ngeometry_msgs/Point point\n";
const QUATERNION_STAMPED: &str = "std_msgs/Header header\ngeometry_msgs/Quaternion quaternion\n";

const DURATION: &str = "MSG: builtin_interfaces/Duration\nint32 sec\nuint32 nanosec\n";
const COLOUR: &str = "MSG: std_msgs/ColorRGBA\nfloat32 r\nfloat32 g\nfloat32 b\nfloat32 a\n";
const COMPRESSED_IMAGE: &str =
    "MSG: sensor_msgs/CompressedImage\nstd_msgs/Header header\nstring format\nuint8[] data\n";
const UV_COORDINATE: &str = "MSG: visualization_msgs/UVCoordinate\nfloat32 u\nfloat32 v\n";
const MESH_FILE: &str = "MSG: visualization_msgs/MeshFile\nstring filename\nuint8[] data\n";

const HEADER: &str = "MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n";
const TIME: &str = "MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n";
const WRENCH: &str = "MSG: geometry_msgs/Wrench\ngeometry_msgs/Vector3 force\ngeometry_msgs/Vector3 torque\n";
const VECTOR3: &str = "MSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z\n";
const POINT: &str = "MSG: geometry_msgs/Point\nfloat64 x\nfloat64 y\nfloat64 z\n";
const QUATERNION: &str = "MSG: geometry_msgs/Quaternion\nfloat64 x\nfloat64 y\nfloat64 z\nfloat64 w\n";
const POSE: &str = "MSG: geometry_msgs/Pose\ngeometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n";
const POSE_WITH_COVARIANCE: &str =
    "MSG: geometry_msgs/PoseWithCovariance\ngeometry_msgs/Pose pose\nfloat64[36] covariance\n";
const TRANSFORM: &str =
    "MSG: geometry_msgs/Transform\ngeometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n";
const TRANSFORM_STAMPED: &str = "\
MSG: geometry_msgs/TransformStamped
std_msgs/Header header
string child_frame_id
geometry_msgs/Transform transform
";
