// What the replay uses of three.js 0.187.0. `three.min.js` is this file, bundled:
//   npm install three@0.187.0 esbuild
//   npx esbuild three_parts.js --bundle --minify --format=iife --global-name=THREE --legal-comments=inline --outfile=three.min.js
export {
  AmbientLight, AxesHelper, BoxGeometry, BufferGeometry, CylinderGeometry, DirectionalLight, GridHelper, Group, Line,
  LineBasicMaterial, Mesh, MeshLambertMaterial, OctahedronGeometry, PerspectiveCamera, Quaternion, Scene, SphereGeometry,
  Vector3, WebGLRenderer,
} from "three";
export { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
