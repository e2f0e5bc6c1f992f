"""The types of messages in recordings, as `ros2 bag record` writes them, each with what it uses."""

from __future__ import annotations

from ros_diagnostics_exporter.sources.action_servers import GOALS_TYPE
from ros_diagnostics_exporter.sources.graph_messages import (
    LOG_TYPE,
    PARAMETERS_TYPE,
    TRANSITION_TYPE,
)

RULE = "=" * 80
_TIME = f"""{RULE}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
_STAMPED = f"""{RULE}
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
{_TIME}"""
SCHEMAS = {
    "diagnostic_msgs/msg/DiagnosticArray": f"""std_msgs/Header header
DiagnosticStatus[] status
{_STAMPED}{RULE}
MSG: diagnostic_msgs/DiagnosticStatus
byte OK=0
byte WARN=1
byte ERROR=2
byte STALE=3
byte level
string name
string message
string hardware_id
KeyValue[] values
{RULE}
MSG: diagnostic_msgs/KeyValue
string key
string value
""",
    LOG_TYPE: f"""uint8 DEBUG=10
uint8 INFO=20
uint8 WARN=30
uint8 ERROR=40
uint8 FATAL=50
builtin_interfaces/Time stamp
uint8 level
string name
string msg
string file
string function
uint32 line
{_TIME}""",
    PARAMETERS_TYPE: f"""builtin_interfaces/Time stamp
string node
Parameter[] new_parameters
Parameter[] changed_parameters
Parameter[] deleted_parameters
{_TIME}{RULE}
MSG: rcl_interfaces/Parameter
string name
ParameterValue value
{RULE}
MSG: rcl_interfaces/ParameterValue
uint8 type
bool bool_value
int64 integer_value
float64 double_value
string string_value
byte[] byte_array_value
bool[] bool_array_value
int64[] integer_array_value
float64[] double_array_value
string[] string_array_value
""",
    TRANSITION_TYPE: f"""uint64 timestamp
Transition transition
State start_state
State goal_state
{RULE}
MSG: lifecycle_msgs/Transition
uint8 id
string label
{RULE}
MSG: lifecycle_msgs/State
uint8 id
string label
""",
    GOALS_TYPE: f"""GoalStatus[] status_list
{RULE}
MSG: action_msgs/GoalStatus
int8 STATUS_UNKNOWN = 0
int8 STATUS_ACCEPTED = 1
int8 STATUS_EXECUTING = 2
int8 STATUS_CANCELING = 3
int8 STATUS_SUCCEEDED = 4
int8 STATUS_CANCELED = 5
int8 STATUS_ABORTED = 6
GoalInfo goal_info
int8 status
{RULE}
MSG: action_msgs/GoalInfo
unique_identifier_msgs/UUID goal_id
builtin_interfaces/Time stamp
{RULE}
MSG: unique_identifier_msgs/UUID
uint8[16] uuid
{_TIME}""",
}
