export {
  BoxGeometry, BufferAttribute, BufferGeometry, ColorManagement, ConeGeometry,
  CustomBlending, CylinderGeometry, DataTexture, DirectionalLight, Float32BufferAttribute, Fog,
  GridHelper, Group, HemisphereLight, LinearFilter, LinearSRGBColorSpace, Matrix4, Mesh,
  MeshBasicMaterial, MeshPhongMaterial, OneFactor, OneMinusSrcAlphaFactor, PCFShadowMap,
  PerspectiveCamera, PlaneGeometry, Quaternion, RGBAFormat, Raycaster, Scene, ShadowMaterial,
  ShapeUtils, Sphere, SphereGeometry, Vector2, Vector3, WebGLRenderer,
} from "three";
export { OrbitControls } from "three/addons/controls/OrbitControls.js";
