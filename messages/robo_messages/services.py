"""Requests and responses of the standard services (ROS: std_srvs).

A service's two types stand in one class and are named `group/Name_Request` and `group/Name_Response`.
"""

from robo_messages._registry import Message, message, type_name


@message("std/Empty")
class Empty(Message):
    """Nothing: a request without arguments, a response that only says that it is done."""


class Trigger:
    """Ask a node to do what the service is named after."""

    @message("std/Trigger_Request")
    class Request(Message):
        """Nothing to say."""

    @message("std/Trigger_Response")
    class Response(Message):
        """How it went."""

        success: bool = True
        """Whether it is done."""
        message: str = ""
        """What was done, or why not."""


class SetBool:
    """Switch something on or off."""

    @message("std/SetBool_Request")
    class Request(Message):
        """On or off."""

        data: bool = False
        """True for on."""

    @message("std/SetBool_Response")
    class Response(Message):
        """How it went."""

        success: bool = True
        """Whether it is done."""
        message: str = ""
        """What was done, or why not."""


def service_type_name(request: type[Message], response: type[Message]) -> str:
    """The name of a service's type, from its two halves: `std/Trigger`.

    Halves that are not named as one service's give both names, joined by `>`.

    Raises:
        UnknownType: one of them was never registered.
    """
    asked, answered = type_name(request), type_name(response)
    name = asked.removesuffix("_Request")
    return name if answered in (asked, f"{name}_Response") else f"{asked}>{answered}"


def halves_of(service_type: str) -> tuple[str, str]:
    """The names of the request and the response of a service's type."""
    asked, arrow, answered = service_type.partition(">")
    if arrow:
        return asked, answered
    if service_type == type_name(Empty):
        return service_type, service_type
    return f"{service_type}_Request", f"{service_type}_Response"
