"""Which services a Compose file has: a router for each robot, one for each process; their names and profiles."""

from collections.abc import Sequence

from robo.export.names import inner_name, robot_of, slug, take
from robo.export.profiles import Profiles
from robo.launch.plan import ProcessPlan

KEEPER = "keeper"


class Layout:
    """The services of a Compose file. No two are called alike."""

    def __init__(self, profiles: Profiles, *, keeper: bool) -> None:
        """
        Args:
            profiles: what always runs, and what runs with a profile.
            keeper: whether there is a service for the keeper.
        """
        plan = profiles.always
        self._names = profiles.names
        self._profiles: dict[str, tuple[str, ...]] = {process.full_name: () for process in plan.processes}
        by_name = {process.full_name: process for process in plan.processes}
        for profile, own in profiles.more.items():
            for process in own:
                by_name.setdefault(process.full_name, process)
                self._profiles[process.full_name] = (*self._profiles.get(process.full_name, ()), profile)
        self.processes = tuple(by_name.values())
        """Each process once, those that always run first."""
        self._robots = self._profiles_of_robots() or {plan.robot: ()}
        self.first = next(iter(self._robots))
        """The robot whose router the others dial, and the host."""
        taken = {KEEPER} if keeper else set()
        self.keeper_profile = take(KEEPER, set(profiles.more)) if keeper else None
        self._routers = {robot: take(f"{self._prefix(robot)}router", taken) for robot in self._robots}
        self._services = {
            process.full_name: take(f"{self._prefix(robot_of(process))}{slug(inner_name(process))}", taken)
            for process in self.processes
        }

    @property
    def robots(self) -> Sequence[str]:
        """The robots, by the first part of their processes' namespace."""
        return tuple(self._robots)

    def router(self, robot: str) -> str:
        """The service that is a robot's router."""
        return self._routers[robot]

    def service(self, full_name: str) -> str:
        """The service that is a process."""
        return self._services[full_name]

    def process(self, full_name: str) -> ProcessPlan:
        """A process by its full name."""
        return next(process for process in self.processes if process.full_name == full_name)

    def profiles_of_router(self, robot: str) -> tuple[str, ...]:
        """The profiles that a robot's router is in; none where it always runs."""
        return self._robots[robot]

    def profiles_of(self, process: ProcessPlan) -> tuple[str, ...]:
        """The profiles that a process is in; none where it always runs."""
        return self._profiles[process.full_name]

    def _profiles_of_robots(self) -> dict[str, tuple[str, ...]]:
        """A robot's router is there with any of its processes."""
        found: dict[str, tuple[str, ...]] = {}
        for process in self.processes:
            robot, own = robot_of(process), self.profiles_of(process)
            if robot not in found:
                found[robot] = own
            elif found[robot]:
                found[robot] = tuple(dict.fromkeys((*found[robot], *own)))
        return found

    def _prefix(self, robot: str) -> str:
        """What the services of a robot begin with: nothing, or the profile that is the robot's own, or its name."""
        if robot == self.first:
            return ""
        profiles = self._robots[robot]
        if len(profiles) == 1 and list(self._robots.values()).count(profiles) == 1:
            return f"{slug(profiles[0])}_"
        return f"{slug(self._names.without(robot)).strip('_') or 'robot'}_"
