// The page: panels in their order, each in a module of its own.

import { link } from "./link.js";
import { bar } from "./panels/bar.js";
import { camera } from "./panels/camera.js";
import { drive } from "./panels/drive.js";
import { events } from "./panels/events.js";
import { graph } from "./panels/graph.js";
import { log } from "./panels/log.js";
import { map } from "./panels/map.js";
import { nodes } from "./panels/nodes.js";
import { parameters } from "./panels/parameters.js";
import { plots } from "./panels/plots.js";
import { topics } from "./panels/topics.js";

bar(document.getElementById("bar"), document.getElementById("lost"));
document
  .getElementById("panels")
  .append(map(), drive(), nodes(), log(), plots(), parameters(), topics(), camera(), graph(), events());
link.open();
