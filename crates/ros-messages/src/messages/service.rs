//! Halves of services of ROS 2: the parameter services of every node, and `std_srvs`.

use std::borrow::Cow;

messages! {
    /// `type` selects the value: 0 none, 1 bool, 2 integer, 3 double, 4 string, 5 to 9 arrays of bytes and of these.
    ParameterValue<'a> "rcl_interfaces/msg/ParameterValue" {
        r#type: u8,
        bool_value: bool,
        integer_value: i64,
        double_value: f64,
        string_value: Cow<'a, str>,
        byte_array_value: Cow<'a, [u8]> = "byte[]",
        bool_array_value: Vec<bool>,
        integer_array_value: Vec<i64>,
        double_array_value: Vec<f64>,
        string_array_value: Vec<Cow<'a, str>>,
    }
    Parameter<'a> "rcl_interfaces/msg/Parameter" { name: Cow<'a, str>, value: ParameterValue<'a>, }
    FloatingPointRange "rcl_interfaces/msg/FloatingPointRange" { from_value: f64, to_value: f64, step: f64, }
    IntegerRange "rcl_interfaces/msg/IntegerRange" { from_value: i64, to_value: i64, step: u64, }
    /// At most one range each.
    ParameterDescriptor<'a> "rcl_interfaces/msg/ParameterDescriptor" {
        name: Cow<'a, str>,
        r#type: u8,
        description: Cow<'a, str>,
        additional_constraints: Cow<'a, str>,
        read_only: bool,
        dynamic_typing: bool,
        floating_point_range: Vec<FloatingPointRange> = "rcl_interfaces/FloatingPointRange[<=1]",
        integer_range: Vec<IntegerRange> = "rcl_interfaces/IntegerRange[<=1]",
    }
    SetParametersResult<'a> "rcl_interfaces/msg/SetParametersResult" { successful: bool, reason: Cow<'a, str>, }
    ListParametersResult<'a> "rcl_interfaces/msg/ListParametersResult" {
        names: Vec<Cow<'a, str>>,
        prefixes: Vec<Cow<'a, str>>,
    }
    ParameterEvent<'a> "rcl_interfaces/msg/ParameterEvent" {
        stamp: super::Time,
        node: Cow<'a, str>,
        new_parameters: Vec<Parameter<'a>>,
        changed_parameters: Vec<Parameter<'a>>,
        deleted_parameters: Vec<Parameter<'a>>,
    }
    GetParametersRequest<'a> "rcl_interfaces/srv/GetParameters_Request" { names: Vec<Cow<'a, str>>, }
    GetParametersResponse<'a> "rcl_interfaces/srv/GetParameters_Response" { values: Vec<ParameterValue<'a>>, }
    GetParameterTypesRequest<'a> "rcl_interfaces/srv/GetParameterTypes_Request" { names: Vec<Cow<'a, str>>, }
    GetParameterTypesResponse<'a> "rcl_interfaces/srv/GetParameterTypes_Response" { types: Cow<'a, [u8]>, }
    SetParametersRequest<'a> "rcl_interfaces/srv/SetParameters_Request" { parameters: Vec<Parameter<'a>>, }
    SetParametersResponse<'a> "rcl_interfaces/srv/SetParameters_Response" { results: Vec<SetParametersResult<'a>>, }
    SetParametersAtomicallyRequest<'a> "rcl_interfaces/srv/SetParametersAtomically_Request" { parameters: Vec<Parameter<'a>>, }
    SetParametersAtomicallyResponse<'a> "rcl_interfaces/srv/SetParametersAtomically_Response" { result: SetParametersResult<'a>, }
    DescribeParametersRequest<'a> "rcl_interfaces/srv/DescribeParameters_Request" { names: Vec<Cow<'a, str>>, }
    DescribeParametersResponse<'a> "rcl_interfaces/srv/DescribeParameters_Response" { descriptors: Vec<ParameterDescriptor<'a>>, }
    /// A depth of 0 requests all levels.
    ListParametersRequest<'a> "rcl_interfaces/srv/ListParameters_Request" { prefixes: Vec<Cow<'a, str>>, depth: u64, }
    ListParametersResponse<'a> "rcl_interfaces/srv/ListParameters_Response" { result: ListParametersResult<'a>, }
    /// Empty: ROS 2 sends one byte for it.
    EmptyRequest "std_srvs/srv/Empty_Request" { structure_needs_at_least_one_member: u8 = "", }
    /// Empty, as [`EmptyRequest`].
    EmptyResponse "std_srvs/srv/Empty_Response" { structure_needs_at_least_one_member: u8 = "", }
    /// Empty, as [`EmptyRequest`].
    TriggerRequest "std_srvs/srv/Trigger_Request" { structure_needs_at_least_one_member: u8 = "", }
    TriggerResponse<'a> "std_srvs/srv/Trigger_Response" { success: bool, message: Cow<'a, str>, }
    SetBoolRequest "std_srvs/srv/SetBool_Request" { data: bool, }
    SetBoolResponse<'a> "std_srvs/srv/SetBool_Response" { success: bool, message: Cow<'a, str>, }
}
